"""The wheel that users install: on a fresh machine, with no checkout in sight, it answers from what was measured."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
import uv

from harness.reports.answers import digest, result_index

UV = uv.find_uv_bin()
ROOT = Path(__file__).parents[2]
MOST = 2_000_000
"""Bytes of measured results in a wheel."""

TRACEBACK = """Traceback (most recent call last):
  File "train.py", line 3, in <module>
    env.step(env.action_space.sample())
  File "/opt/env/lib/python3.11/site-packages/gym/utils/passive_env_checker.py", line 233, in env_step_passive_checker
    if not isinstance(terminated, (bool, np.bool8)):
AttributeError: module 'numpy' has no attribute 'bool8'
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of this checkout."""
    folder = tmp_path_factory.mktemp("dist")
    done = subprocess.run([UV, "build", "--wheel", "-o", folder, ROOT], capture_output=True, text=True, check=False)
    if done.returncode and "Failed to fetch" in done.stderr:
        pytest.skip("unavailable: package index")
    assert done.returncode == 0, done.stderr
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return a function that runs the installed command in an empty folder, with an empty home, cache and state."""
    folder = tmp_path_factory.mktemp("fresh")
    for command in (
        [UV, "venv", "-q", "--python", sys.executable, folder / "venv"],
        [UV, "pip", "install", "-q", "--python", folder / "venv", wheel],
    ):
        subprocess.run(command, check=True)

    def run(*arguments: str, said: str = "") -> subprocess.CompletedProcess[str]:
        (folder / "empty").mkdir(exist_ok=True)
        return subprocess.run(
            [folder / "venv" / "bin" / "simmatrix", *arguments],
            cwd=folder / "empty",
            env={"PATH": os.defpath, "HOME": str(folder / "home"), "COLUMNS": "200"},
            input=said,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )

    return run


def test_it_carries_what_was_measured(wheel: Path) -> None:
    """The wheel has the results of all the checkout's reports in two files below 2 MB, which are reproducible."""
    with zipfile.ZipFile(wheel) as archive:
        packed = archive.read("harness/measured.json.gz")
        reports = archive.read("harness/reports.zip")
        names = archive.namelist()

    assert len(packed) + len(reports) < MOST
    assert reports == digest.pack_reports(result_index.report_files())
    assert packed == digest.pack(result_index.load_shipped())
    assert not [name for name in names if name.startswith("reports/") or name.endswith("report.json")]


def test_it_recommends_on_a_fresh_machine(installed: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    """`recommend` gives the checkout's answer on a fresh machine, with locks that installers accept."""
    done = installed("recommend", "robosuite", "gymnasium", "--python", "3.11", "--needs", "render", "--json")

    told = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert told["measured"]
    assert all(one["lock"].count("--hash=sha256:") >= one["lock"].count("==") for one in told["measured"])


def test_recommended_cells_open_on_a_fresh_machine(
    installed: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    """Recommended cells, reports and known issues are shown, and a lock is written, without any checkout."""
    said = installed("recommend", "gymnasium", "mujoco").stdout
    cells, issues = re.findall(r"simmatrix show (\S+)", said), re.findall(r"simmatrix known (\S+)", said)
    assert cells
    assert issues

    opened = [installed("show", cell) for cell in cells] + [installed("known", issue) for issue in issues]
    written = installed("show", cells[0], "--lock-out", "lock.txt")
    report = installed("report", cells[0].partition("/")[0])

    assert [one.returncode for one in (*opened, written)] == [0] * (len(opened) + 1)
    assert [one.stdout.splitlines()[0] for one in opened] == [*cells, *issues]
    assert report.returncode in {0, 1}
    assert report.stdout.startswith(f"{cells[0].partition('/')[0]}: ")


def test_it_builds_a_site_on_a_fresh_machine(
    installed: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """A report of the wheel becomes a site, which says that its evidence is elsewhere; an unknown one is refused."""
    done = installed("site", "drift-mjx", "--out", str(tmp_path / "site"))

    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site/packages/mujoco/index.html").is_file()
    (page, *_) = sorted((tmp_path / "site/cells/drift-mjx").iterdir())
    assert "This report came without locks, logs and pictures." in page.read_text(encoding="utf-8")
    assert [path.name for path in (tmp_path / "site/files").rglob("*.svg")] == ["behaviour-1.svg"]  # drawn anew
    refused = installed("site", "nowhere", "--out", str(tmp_path / "other"))
    assert refused.returncode == 2
    assert refused.stderr.startswith("simmatrix: nowhere: no report.json here, and no matrix of this name was measured")
    assert not (tmp_path / "other").exists()


def test_it_explains_on_a_fresh_machine(installed: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    """A traceback is explained by the signatures in the wheel."""
    done = installed("explain", "-", "--json", said=TRACEBACK)

    told = json.loads(done.stdout)
    assert [one["signature"] for one in told["diagnoses"]][:1] == ["numpy2-bool8-gym-checker"]
    assert done.returncode == 0


def test_it_examines_an_environment_on_a_fresh_machine(
    installed: Callable[..., subprocess.CompletedProcess[str]],
) -> None:
    """`doctor` looks at its own environment, and knows measured results to compare it with."""
    done = installed("doctor", "--python", sys.executable, "--json")

    assert done.returncode in {0, 1}, done.stderr
    assert json.loads(done.stdout)["schema"] == 1

"""The tools themselves take the output of `recommend --format`: pip, uv, and the shell of a Dockerfile."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import uv

from harness.machine import interpreters

UV = uv.find_uv_bin()
ASKED = ["gymnasium", "--python", "3.11", "--env", "CartPole-v1"]
RUNS = "import gymnasium; print(gymnasium.make('CartPole-v1').reset(seed=0)[0].shape)"


@pytest.fixture
def plain(tmp_path: Path) -> dict[str, str]:
    """Return the variables of a shell without an environment, that finds uv and Python 3.11 first."""
    found = interpreters.find("3.11")
    if found is None:
        pytest.skip("unavailable: python3.11")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("VIRTUAL_ENV", "UV_PYTHON"))}
    places = {"HARNESS_STATE": str(tmp_path / "state"), "HARNESS_CACHE": str(tmp_path / "cache")}
    return kept | places | {"PATH": os.pathsep.join([str(Path(UV).parent), str(Path(found.path).parent), kept["PATH"]])}


def recommend(folder: Path, plain: dict[str, str], name: str) -> str:
    """Return what a format prints."""
    command = [sys.executable, "-m", "harness", "recommend", *ASKED, "--format", name]
    return subprocess.run(command, cwd=folder, env=plain, capture_output=True, text=True, check=True).stdout


def run(command: str, folder: Path, plain: dict[str, str]) -> str:
    """Run a line of a shell in an environment that lies in `.venv`, and return its output."""
    python = folder / ".venv" / "bin"
    path = {"PATH": os.pathsep.join([str(python), plain["PATH"]])}
    done = subprocess.run(
        command, shell=True, cwd=folder, env=plain | path, capture_output=True, text=True, check=False
    )
    if "Failed to fetch" in done.stderr or "Could not fetch" in done.stderr:
        pytest.skip("unavailable: package index")
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", ["pip", "uv", "dockerfile"])
def test_commands_install(tmp_path: Path, plain: dict[str, str], name: str) -> None:
    """The first line of pip's and uv's answer, and the RUN line of a Dockerfile, make what was measured run."""
    text = recommend(tmp_path, plain, name)
    command = re.split(r"^RUN (?=pip )", text, flags=re.MULTILINE)[-1] if name == "dockerfile" else text.splitlines()[0]
    if name != "uv":
        run(f"uv venv -q --seed --python {interpreters.find('3.11').path}", tmp_path, plain)

    run(command, tmp_path, plain)

    assert run(f'python -c "{RUNS}"', tmp_path, plain) == "(4,)\n"


def test_a_project_resolves(tmp_path: Path, plain: dict[str, str]) -> None:
    """uv locks the project, with the versions that were measured."""
    (tmp_path / "pyproject.toml").write_text(recommend(tmp_path, plain, "pyproject"))

    run("uv lock", tmp_path, plain)

    locked = (tmp_path / "uv.lock").read_text()
    assert re.search(r'name = "gymnasium"\nversion = "1\.\d+\.\d+"', locked)

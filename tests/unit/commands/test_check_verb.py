"""`simmatrix check` and `simmatrix upgrade` over the results that ship with the harness."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from harness.__main__ import main
from harness.model.schema import json_schema
from harness.reports.projects.check_document import Checked, CheckedFiles
from harness.reports.projects.upgrade_document import Upgraded

ENVIRONMENT = "lib/python3.11/site-packages"


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty working folder; measured results are distilled once for all tests of this process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    for name in ("HARNESS_RESULTS", "VIRTUAL_ENV", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def written(folder: Path, text: str, name: str = "requirements.txt") -> str:
    """Write a requirement file and return its name."""
    (folder / name).write_text(text, encoding="utf-8")
    return name


def check(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    """Return the exit code and the document of `check`."""
    code = main(["check", *arguments, "--json"])
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, json_schema(Checked))
    return code, document


def environment(folder: Path, **packages: str) -> str:
    """Make the folders of an environment that holds packages, and return its path."""
    root = folder / "venv"
    (root / "bin").mkdir(parents=True)
    interpreter = root / "bin" / "python"
    interpreter.write_text("#!/bin/sh\n")
    interpreter.chmod(0o755)
    (root / "pyvenv.cfg").write_text("version = 3.11.7\n")
    for name, version in packages.items():
        info = root / ENVIRONMENT / f"{name}-{version}.dist-info"
        info.mkdir(parents=True)
        requires = "Requires-Dist: mujoco<3.4\n" if name == "keeper" else ""
        (info / "METADATA").write_text(f"Name: {name}\nVersion: {version}\n{requires}\nText\n")
    return str(root)


# --- check -----------------------------------------------------------------------------------------------------


def test_measured_versions_are_good(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """A pinned file that a cell holds: good, the cell can be opened; what is not judged is named with its line."""
    text = "gymnasium[mujoco]==1.2.3\nmujoco==3.3.7\nnumpy==2.2.6\nwandb\ngit+https://example.org/x\n"
    code, document = check(capsys, "-r", written(fresh, text))

    (finding,) = document["findings"]
    assert (code, finding["kind"]) == (0, "good")
    assert finding["versions"] == {"gymnasium": "1.2.3", "mujoco": "3.3.7"}
    assert document["not_run"] == ["wandb"]
    assert document["unjudged"][0].startswith("requirements.txt:5: ")
    assert main(["show", finding["cells"][0]]) == 0


def test_a_range_across_broken_releases_and_boundaries(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """gymnasium>=0.29 admits 0.29.1, whose Swimmer-v4 no MuJoCo 3 reads; mujoco>=3.1 crosses 3.5.0."""
    code, document = check(capsys, "-r", written(fresh, "gymnasium[mujoco]>=0.29\nmujoco>=3.1\nnumpy\n"))

    kinds = [finding["kind"] for finding in document["findings"]]
    causes = {cause for finding in document["findings"] for cause in finding["causes"]}
    (crossing,) = [finding for finding in document["findings"] if finding["kind"] == "changes"]
    assert code == 1
    assert {"good", "admits", "changes"} == {*kinds}
    assert "mujoco3-removed-option-collision" in causes
    assert "3.5.0" in crossing["text"]


def test_numpy_left_open_beside_gym(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """gym 0.26.2 without a bound on NumPy admits NumPy 2, with which its checker fails: the fix is named."""
    code, document = check(capsys, "-r", written(fresh, "gym==0.26.2\n"))

    fixes = {finding["fix"] for finding in document["findings"] if finding["kind"] == "admits"}
    assert code == 1
    assert any(fix and "numpy<2" in fix for fix in fixes)


def test_formats(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """uv.lock, environment.yml with packages of conda, and pyproject.toml name the same versions: the same answer."""
    pins = {"gymnasium": "1.2.3", "mujoco": "3.3.7", "numpy": "2.2.6", "imageio": "2.37.0"}
    packages = "".join(
        f'[[package]]\nname = "{name}"\nversion = "{version}"\nsource = {{ registry = "index" }}\n'
        for name, version in pins.items()
    )
    lock = (
        f'version = 1\nrequires-python = "==3.11.*"\n{packages}[[package]]\nname = "me"\nsource = {{ virtual = "." }}\n'
    )
    conda = "dependencies:\n  - python=3.11\n" + "".join(f"  - {name}={version}\n" for name, version in pins.items())
    project = '[project]\nname = "x"\nversion = "1"\nrequires-python = "==3.11.*"\ndependencies = ' + json.dumps(
        [f"{name}=={version}" for name, version in pins.items()]
    )
    answers = [
        check(capsys, "-r", written(fresh, text, name))
        for name, text in (("uv.lock", lock), ("environment.yml", conda), ("pyproject.toml", project))
    ]

    assert [code for code, _ in answers] == [0, 0, 0]
    assert len({finding["text"] for _, document in answers for finding in document["findings"]}) == 1
    assert all(document["unjudged"] == [] for _, document in answers)


def test_every_file_for_itself(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """`--each` judges files apart: together these two ask for two releases of one package."""
    first = written(fresh, "mujoco==3.3.7\ngymnasium[mujoco]==1.2.3\nnumpy==2.2.6\n", "a.txt")
    second = written(fresh, "mujoco==3.4.0\ngymnasium[mujoco]==1.2.3\nnumpy==2.2.6\n", "b.txt")

    code, document = check(capsys, "-r", first, second)
    assert (code, document["findings"][0]["kind"]) == (1, "conflict")
    assert main(["check", "--each", "-r", first, second, "--json"]) == 0
    files = json.loads(capsys.readouterr().out)
    jsonschema.validate(files, json_schema(CheckedFiles))
    assert [each["source"] for each in files["files"]] == ["a.txt", "b.txt"]


def test_an_environment_at_hand(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """The packages of an environment are read from its folders; nothing of it is run."""
    place = environment(fresh, gymnasium="1.2.3", mujoco="3.3.7", numpy="2.4.6")
    code, document = check(capsys, "--python", place)

    assert (code, document["python"]) == (0, "3.11.7")
    assert document["findings"][0]["kind"] == "good"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "requirements.txt: names no package"),
        ("numpy\ngymnasium=>1\n", "requirements.txt:2: 'gymnasium=>1' is not a requirement"),
        ("numpy\nmujoco==3.3.77\n", "requirements.txt:2: mujoco 3.3.77: no such release; near it are 3.3.7 and 3.4.0"),
    ],
)
def test_bad_files(capsys: pytest.CaptureFixture[str], fresh: Path, text: str, message: str) -> None:
    """A file that asks for nothing, a line that cannot be read, a release that does not exist: 2, file and line."""
    code = main(["check", "-r", written(fresh, text)])

    assert (code, message in capsys.readouterr().err) == (2, True)


def test_bad_arguments(capsys: pytest.CaptureFixture[str], fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that is not there, an environment id that is misspelt, no environment at hand: 2."""
    name = written(fresh, "gymnasium==1.2.3\n")
    assert main(["check", "-r", "nothing.txt"]) == 2
    assert main(["check", "-r", name, "--env", "Antt-v5"]) == 2
    assert "did you mean Ant-v5?" in capsys.readouterr().err
    monkeypatch.setenv("PATH", os.devnull)
    assert main(["check"]) == 2
    assert "there is no Python here" in capsys.readouterr().err


# --- upgrade ---------------------------------------------------------------------------------------------------


def upgrade(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    """Return the exit code and the document of `upgrade`."""
    code = main(["upgrade", *arguments, "--json"])
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, json_schema(Upgraded))
    return code, document


def test_an_upgrade_across_a_boundary(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """mujoco 3.4.0 to 3.5.0: everything runs, Ant-v5 and others behave otherwise; no newer release changes nothing."""
    place = environment(fresh, gymnasium="1.2.3", mujoco="3.4.0", numpy="2.4.6", pip="24.0")
    code, document = upgrade(capsys, "mujoco==3.5.0", "--python", place)

    assert code == 1
    assert document["install"]["possible"] is True
    assert all(task["works"] for task in document["running"])
    assert {"Ant-v5", "Hopper-v5"} <= {change["env"] for change in document["behaviour"]["changed"]}
    assert {"HalfCheetah-v5", "Reacher-v5"} <= {*document["behaviour"]["same"]}
    assert document["unchanging"] == {"mujoco": None}
    assert document["command"] == [f"{place}/bin/python -m pip install mujoco==3.5.0"]


def test_an_upgrade_within_a_family(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """mujoco 3.3.7 to 3.4.0 changes nothing of Gymnasium's tasks: 0, and 3.4.0 is the newest such release."""
    place = environment(fresh, gymnasium="1.2.3", mujoco="3.3.7", numpy="2.4.6")
    code, document = upgrade(capsys, "mujoco==3.4.0", "--python", place)

    assert (code, document["behaviour"]["changed"]) == (0, [])
    assert document["unchanging"] == {"mujoco": "3.4.0"}


def test_a_package_that_asks_for_the_old_release(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """An installed package keeps the new release out: it cannot be installed, and who says so is named."""
    place = environment(fresh, gymnasium="1.2.3", mujoco="3.3.7", numpy="2.4.6", keeper="1.0")
    code, document = upgrade(capsys, "mujoco==3.4.0", "--python", place)

    assert code == 1
    assert document["install"]["blockers"] == ["keeper 1.0 asks for mujoco<3.4"]


def test_the_answer_in_words(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """One line a question, the command last."""
    place = environment(fresh, gymnasium="1.2.3", mujoco="3.3.7", numpy="2.4.6")
    main(["upgrade", "mujoco==3.5.0", "--python", place])

    lines = capsys.readouterr().out.splitlines()
    labels = [line.split()[0] for line in lines if line[:1].strip()]
    assert labels == ["mujoco", "install", "run", "behave", "pictures", "newest"]
    assert lines[-1].strip().endswith("mujoco==3.5.0")


def test_a_package_that_is_pulled_along(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """dm-control 1.0.50 requires MuJoCo 3.17 or newer: a resolver takes 4.0.0, with which its tasks fail."""
    name = written(fresh, "dm-control==1.0.28\nmujoco==3.3.0\n")
    code, document = upgrade(capsys, "dm-control==1.0.50", "-r", name)

    (pulled,) = [move for move in document["moves"] if move["pulled"]]
    assert (code, pulled["name"], document["install"]["pulled"]) == (1, "mujoco", {"mujoco": ">=3.17.0"})
    fails = {task["env"]: task["line"] for task in document["running"] if not task["works"]}
    assert "flex_vertedge" in fails["cheetah/run"]


def test_numpy_2_beside_gym(capsys: pytest.CaptureFixture[str], fresh: Path) -> None:
    """Few tasks of gym 0.26.2 were run with the newest NumPy; other NumPy 2 stand for it, and all fail."""
    code, document = upgrade(capsys, "numpy", "-r", written(fresh, "gym==0.26.2\nnumpy==1.26.4\n"))

    fails = [task for task in document["running"] if not task["works"]]
    assert code == 1
    assert len(fails) > 1
    assert all("bool8" in task["line"] for task in fails)
    assert {task["other_versions"].get("numpy", "2.")[:2] for task in fails} == {"2."}

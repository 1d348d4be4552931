"""Everything that a verb prints can be opened, from the shipped results, too: cells, reports, known issues."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import pytest

from harness.__main__ import main
from harness.commands.known import KnownDocument
from harness.model.schema import json_schema
from harness.reports.answers import digest, result_index, shipped_reports

REPORTS = Path(__file__).parents[3] / "reports"


@pytest.fixture(autouse=True)
def fresh(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder without a store."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HARNESS_RESULTS", raising=False)
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
    return tmp_path


@pytest.mark.parametrize("asked", [["gymnasium", "mujoco"], ["robosuite", "torch"], ["metaworld"], ["gym", "--all"]])
def test_commands_that_recommend_prints_open(capsys: pytest.CaptureFixture[str], asked: list[str]) -> None:
    """Each `simmatrix show CELL` and `simmatrix known ID` of an answer works."""
    main(["recommend", *asked])
    said = capsys.readouterr().out
    cells = sorted(set(re.findall(r"simmatrix show (\S+)", said)))[:20]
    issues = sorted(set(re.findall(r"simmatrix known (\S+)", said)))

    assert cells or asked == ["robosuite", "torch"]
    for cell in cells:
        assert main(["show", cell]) == 0
        assert capsys.readouterr().out.startswith(f"{cell}\n")
    for issue in issues:
        assert main(["known", issue]) == 0
        told = capsys.readouterr().out
        assert told.startswith(f"{issue}\n  symptom ")
        assert main(["explain", "--id", issue]) == 0
        assert capsys.readouterr().out == told


def test_every_measured_cell_opens(capsys: pytest.CaptureFixture[str]) -> None:
    """Of each report the first red cell: its line, its known issue, its lock."""
    for name in shipped_reports.names():
        report = json.loads((REPORTS / name / "report.json").read_bytes())
        red = [cell for cell in report["cells"] if cell["decisive"] and cell["measured"]]
        for cell in red[:1]:
            assert main(["show", cell["id"]]) == 0
            said = capsys.readouterr().out
            assert cell["decisive"] in said
            assert all(f"known as {one['signature']}" in said for one in cell["diagnoses"][:1] if not one["masks"])


def test_reports_open_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    """`report NAME` of a report that came with the harness; a wrong name is told the nearest."""
    assert main(["report", "quickstart"]) in {0, 1}
    assert capsys.readouterr().out.startswith("quickstart: ")
    assert main(["report", "quikstart"]) == 2
    assert 'did you mean "quickstart"?' in capsys.readouterr().err


def test_measured_packages_and_known_issues_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    """Packages that cases ran, and all known issues, by a schema."""
    assert main(["known", "--json"]) == 0

    document = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, json_schema(KnownDocument))
    packages = {one["name"]: one for one in document["packages"]}
    assert {"gymnasium", "mujoco", "robosuite", "numpy"} <= packages.keys()
    assert "tensorstore" not in packages
    assert "1.27.0" in packages["pettingzoo"]["works"]
    assert "pettingzoo" in packages["pettingzoo"]["reports"]
    assert "1.4.0" in packages["gymnasium"]["works"]
    assert packages["metaworld"]["works"] == ["3.1.1", "3.0.0"]
    assert len(document["issues"]) > 200


def test_a_package_is_opened(capsys: pytest.CaptureFixture[str]) -> None:
    """Releases that work, reports that hold it, issues that concern it."""
    assert main(["known", "gymnasium_robotics"]) == 0

    said = capsys.readouterr().out
    assert said.startswith("gymnasium-robotics: ")
    assert "  simmatrix report gymnasium-robotics\n" in said
    assert "\n  gymnasium-packaging-missing: " in said


@pytest.mark.parametrize(
    ("arguments", "near"),
    [
        (["known", "metawrld"], "did you mean metaworld?"),
        (["known", "numpy2-bool8-gym-chcker"], "did you mean numpy2-bool8-gym-checker"),
        (["explain", "--id", "numpy2-bool8-gym-chcker"], "did you mean numpy2-bool8-gym-checker?"),
        (["show", "quickstart/py3.11_gymnasium-1.4.0_mujoco-3.3.8"], "did you mean quickstart/py3.11_gymnasium-1.4.0_"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest(
    capsys: pytest.CaptureFixture[str], arguments: list[str], near: str
) -> None:
    """A wrong name is bad input, exit code 2, and the message suggests the nearest name."""
    assert main(arguments) == 2
    assert near in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["known"], ["explain", "--id"]])
def test_an_id_of_before_still_opens(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    """Two issues became one: reports of before name the other id."""
    assert main([*arguments, "mujoco-before-numpy2-lurking"]) == 0
    assert capsys.readouterr().out.startswith("mujoco-before-numpy2-vectors\n")


def test_a_wheel_opens_them_too(
    capsys: pytest.CaptureFixture[str], fresh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Packed as in a wheel, without any file beside: the same cells and reports."""
    file = REPORTS / "quickstart" / "report.json"
    report = json.loads(file.read_bytes())
    packed = fresh / "reports.zip"
    packed.write_bytes(digest.pack_reports([file]))
    monkeypatch.setattr(shipped_reports, "PACKED", packed)
    monkeypatch.setattr(result_index, "report_files", list)
    shipped_reports.load.cache_clear()
    red = next(cell for cell in report["cells"] if cell["decisive"])

    try:
        assert shipped_reports.names() == ["quickstart"]
        assert main(["show", red["id"]]) == 0
        said = capsys.readouterr().out
        assert red["decisive"] in said
        assert "evidence   " not in said, "nothing is named that is not there"
        assert main(["report", "quickstart"]) in {0, 1}
    finally:
        shipped_reports.load.cache_clear()


def test_the_lock_of_a_cell_is_written(fresh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`show CELL --lock-out` writes the lock with its header."""
    cell = "quickstart/py3.11_gymnasium-1.4.0_mujoco-3.3.7"

    assert main(["show", cell, "--lock-out", "lock.txt"]) == 0

    text = (fresh / "lock.txt").read_text()
    assert text.startswith(f"# simmatrix: {cell}\n# Python 3.11")
    assert "gymnasium==1.4.0 \\\n    --hash=sha256:" in text

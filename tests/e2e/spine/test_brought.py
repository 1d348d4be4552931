"""Software that is on no index: named by the user, copied for the cell, and marked in its results."""

from __future__ import annotations

import json
import subprocess
import tarfile
from pathlib import Path

import pytest
from commandline import CommandResult, Desk

MATRIX = """
requirements = ["fake-healthy"]
python_path = ["lib"]
empty = ["SET_TO_NOTHING"]
page = "page.md.j2"
files = { "lib/beside.py" = { source = "beside.py" } }

[index]
no_index = true
find_links = ["@WHEELS@"]

[bring.study]
variable = "STUDY"
say = "clone the study, and have STUDY name the folder"
python_path = [".", "code", "of-an-older-release"]

[axes]
python = ["host"]

[[cases]]
env = "beside:make"
api = "gymnasium"
checks = ["single"]
"""
BESIDE = """
import os

import fake_healthy
import study

assert os.environ["SET_TO_NOTHING"] == ""
assert study.__file__.startswith(os.environ["STUDY"])


def make():
    print("seen:", study.NAME, os.environ["STUDY"], flush=True)
    return study.broken() if study.NAME == "broken" else fake_healthy.Healthy()
"""


@pytest.fixture
def matrix(desk: Desk) -> Path:
    """Write the matrix and the files beside it; return the matrix's path."""
    (desk.folder / "beside.py").write_text(BESIDE)
    (desk.folder / "page.md.j2").write_text("{{ document.cells[0].verdict }}\n")
    return desk.matrix("needy", MATRIX)


@pytest.fixture
def study(desk: Desk) -> Path:
    """Return a checkout whose module lies in a subfolder."""
    folder = desk.folder / "a study"
    (folder / "code").mkdir(parents=True)
    (folder / "code" / "study.py").write_text("NAME = 'sound'\n")
    return folder


def test_without_it_the_cell_is_unavailable(desk: Desk, matrix: Path) -> None:
    """Without the software the cell is unavailable; the message says what to do and the page is still written."""
    ran = desk.run("run", matrix, "--json")
    (cell,) = ran.document["cells"]

    assert (ran.code, cell["verdict"], cell["as_expected"], cell["phases"]["resolve"]) == (
        0, "unavailable", None, "unavailable",
    )  # fmt: skip
    told = "study is not here, and STUDY names no place of it: clone the study, and have STUDY name the folder"
    assert cell["decisive"] == told
    assert (desk.state / "reports" / "needy" / "README.md").read_text() == "unavailable\n"


def test_a_place_that_is_none_is_bad_input(desk: Desk, matrix: Path) -> None:
    """A variable that names nothing is bad input, not missing software."""
    ran = desk.run("run", matrix, STUDY=str(desk.folder / "gone"))

    told = f"simmatrix: STUDY: {desk.folder}/gone is neither a folder nor an archive; clone the study, and have STUDY"
    assert (ran.code, told in ran.err) == (2, True)


def test_a_folder_is_copied_and_its_state_decides(desk: Desk, matrix: Path, study: Path) -> None:
    """The cell imports from a copy, whose path is not in the log; only a changed folder is measured again."""
    first, again = _run(desk, matrix, study), _run(desk, matrix, study)
    (study / "code" / "study.py").write_text("NAME = 'broken'\ndef broken():\n    raise ValueError('of the study')\n")
    broken = _run(desk, matrix, study)

    assert [(ran.code, cell["verdict"], cell["reused"]) for ran in (first, again, broken) for cell in _cells(ran)] == [
        (0, "works", False), (0, "works", True), (1, "broken", False),
    ]  # fmt: skip
    assert _cells(broken)[0]["decisive"] == "ValueError: of the study"
    assert (_cells(broken)[0]["empty"], _cells(broken)[0]["environment"]) == (["SET_TO_NOTHING"], {})
    marks = [_cells(ran)[0]["brought"][0]["mark"] for ran in (first, again, broken)]
    assert (marks[0] == marks[1], marks[1] == marks[2]) == (True, False)
    log = next((desk.state / "reports" / "needy").rglob("log.txt")).read_text()
    assert "seen: broken $STUDY" in log
    assert not list(study.rglob("__pycache__"))


def test_a_repository_and_an_archive_are_as_good(desk: Desk, matrix: Path, study: Path) -> None:
    """The result of a checkout has its commit and whether its files differ from it; an archive is unpacked."""
    with tarfile.open(desk.folder / "study.tar.gz", "w:gz") as archive:
        archive.add(study, arcname=".")
    _git(study, "init", "--quiet")
    _git(study, "add", ".")
    _git(study, "-c", "user.name=a", "-c", "user.email=a@b", "commit", "--quiet", "-m", "first")
    commit = _git(study, "rev-parse", "HEAD")

    unpacked = _run(desk, matrix, desk.folder / "study.tar.gz")
    clean = _run(desk, matrix, study)
    (study / "notes.txt").write_text("changed")
    changed = _run(desk, matrix, study)

    assert [_cells(ran)[0]["verdict"] for ran in (unpacked, clean, changed)] == ["works"] * 3
    told = [{name: one[name] for name in ("commit", "changed")} for ran in (unpacked, clean, changed)
            for one in _cells(ran)[0]["brought"]]  # fmt: skip
    assert told == [
        {"commit": None, "changed": False},
        {"commit": commit, "changed": False},
        {"commit": commit, "changed": True},
    ]


@pytest.mark.parametrize(
    ("template", "message"),
    [
        ("{{ cell('py9').verdict }}", 'its page speaks of a cell "py9", which the matrix does not have'),
        ("{{ nothing }}", "the page of needy: 'nothing' is undefined"),
        ("a\n{% if %}", "the page of needy: line 2: Expected an expression, got 'end of statement block'"),
    ],
)
def test_a_wrong_page_is_bad_input(desk: Desk, matrix: Path, template: str, message: str) -> None:
    """Errors in a page's template are reported as bad input."""
    (desk.folder / "page.md.j2").write_text(template)
    ran = desk.run("run", matrix)

    assert (ran.code, ran.err.splitlines()[-1]) == (2, f"simmatrix: {message}")


def _run(desk: Desk, matrix: Path, study: Path) -> CommandResult:
    return desk.run("run", matrix, "--json", STUDY=str(study))


def _cells(ran: CommandResult) -> list[dict[str, object]]:
    return list(json.loads(ran.out)["cells"])


def _git(folder: Path, *arguments: str) -> str:
    done = subprocess.run(("git", "-C", folder, *arguments), capture_output=True, text=True, check=True)
    return done.stdout.strip()

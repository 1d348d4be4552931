"""A stored report compared anew with what is known now."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from builders import GENERATED, MACHINES, case, cell, document_of, knowing, phase, record

from harness import document, rediagnosing, signature_files
from harness.__main__ import main
from harness.model import CellRecord, Change, Expectation, Outcome, Phase, Plan, Step, Tried, Verdict
from harness.reporttypes import CellEntry, Document
from harness.signatures import read

SIGNATURES = read(
    {
        "a.toml": """
[[signature]]
id = "told"
phases = ["render"]
pattern = "solver_iter"
packages = ["gymnasium<2"]
cause = "because"
examples = ["solver_iter", "no solver_iter", "again: solver_iter"]
remedy = { requirements = ["mujoco<3"] }

[[signature]]
id = "written"
phases = ["vector", "install", "resolve"]
pattern = "deep in a log"
cause = "deep"
examples = ["deep in a log", "so deep in a log", "again: deep in a log"]
remedy = { text = "dig" }
"""
    }
)
BASE = cell()
CURED = replace(
    cell("py3.11_gymnasium-1.2.3_with-cure"),
    base=BASE.id,
    tried=Tried(name="cure", reason="why", change=Change(requirements=("mujoco<3",))),
)
RED = record(case("pppf", render=phase(Phase.RENDER, Outcome.FAILED, "no solver_iter")))


def made(*records: CellRecord) -> Document:
    """A report of the time when nothing was known."""
    return document_of(*records, axes=("python", "gymnasium"))


def causes(found: Document) -> list[list[str]]:
    """Signatures of each cell."""
    return [[one.signature for one in entry.diagnoses] for entry in found.cells]


def first(found: Document) -> CellEntry:
    """The first cell."""
    return found.cells[0]


def test_a_line_is_known_now() -> None:
    """A red cell gets its cause, with the line and the remedy, and nothing else of it changes."""
    before = made(RED)

    after = rediagnosing.diagnosed(before, knowing(*SIGNATURES))

    assert (causes(before), causes(after)) == ([[]], [["told"]])
    assert first(after).diagnoses[0].seen == "no solver_iter"
    assert first(after).diagnoses[0].remedy == {"requirements": ["mujoco<3"]}
    plain, same = (json.loads(document.encode(one)) for one in (before, after))
    same["cells"][0]["diagnoses"] = []
    assert plain == same


def test_it_comes_to_the_same_as_when_it_was_measured() -> None:
    """From the document alone the same is told as from the records."""
    log = {"1": {"log.txt": "so deep in a log"}}
    vector = phase(Phase.VECTOR, Outcome.FAILED, "silence", evidence="evidence/1")
    records = (replace(RED, cases=(*RED.cases, *record(case("ppfp", "b", vector=vector)).cases)),)
    planned = Plan(matrix="quick", cells=(BASE,), axes=())
    known = knowing(*SIGNATURES, **log)

    then = document.build(records, [planned], MACHINES, GENERATED, known=known)
    now = rediagnosing.diagnosed(document.build(records, [planned], MACHINES, GENERATED), known)

    assert causes(now) == [["told", "written"]]
    assert now == then


@pytest.mark.parametrize("at", [Phase.RESOLVE, Phase.INSTALL])
def test_logs_of_a_step_are_read(at: Phase) -> None:
    """A cell that did not come to its cases is told by the log of the step."""
    step = Step(phase=at, outcome=Outcome.FAILED, decisive="no", log="evidence/uv")
    steps = {"resolve": step, "install": None} if at is Phase.RESOLVE else {"install": step}
    red = record(installed=None, of=BASE, **steps)

    after = rediagnosing.diagnosed(made(red), knowing(*SIGNATURES, uv={"uv.log": "so deep in a log"}))

    assert causes(after) == [["written"]]


def test_what_is_not_red_has_no_cause() -> None:
    """Neither a green cell, nor one whose packages do not fit the signature."""
    other = replace(RED, installed={"gymnasium": "2.0"})

    assert causes(rediagnosing.diagnosed(made(record(case("pppp"))), knowing(*SIGNATURES))) == [[]]
    assert causes(rediagnosing.diagnosed(made(other), knowing(*SIGNATURES))) == [[]]


def test_a_remedy_is_proven_by_the_cell_that_was_made_by_it() -> None:
    """A change that was tried before its signature was known proves the remedy, if it is the same word for word."""
    cured = record(case("pppp"), of=CURED)
    before = made(RED, cured)
    assert before.cells[1].change
    assert before.cells[1].change.remedy_of == ()

    proven = rediagnosing.diagnosed(before, knowing(*SIGNATURES))
    other = replace(CURED, tried=replace(CURED.tried, change=Change(requirements=("mujoco<2",))))
    unproven = rediagnosing.diagnosed(made(RED, record(case("pppp"), of=other)), knowing(*SIGNATURES))

    assert first(proven).diagnoses[0].proof == CURED.id
    assert first(unproven).diagnoses[0].proof is None


@pytest.mark.parametrize(("signature", "is_it"), [("told", True), ("written", False)])
def test_what_is_expected_is_judged_again(signature: str, is_it: bool) -> None:
    """An expectation that names a signature is met once that is known to fit."""
    expect = Expectation(verdict=Verdict.PARTIAL, signature=signature, reason="known")
    before = made(replace(RED, cell=replace(BASE, expect=expect)))

    assert first(before).as_expected is False
    assert first(rediagnosing.diagnosed(before, knowing(*SIGNATURES))).as_expected is is_it


def test_what_a_matrix_expects_no_more_is_not_as_expected() -> None:
    """A red cell whose expectation was taken away is judged as one without."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known")
    before = made(replace(RED, cell=replace(BASE, expect=expect)))
    cells = tuple(msgspec.structs.replace(cell, expectation=None) for cell in before.cells)

    assert first(before).as_expected is True
    assert first(rediagnosing.diagnosed(msgspec.structs.replace(before, cells=cells), knowing())).as_expected is False


def test_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`report FOLDER --diagnose --out FOLDER` leaves the report there with its causes, its files as they were."""
    (tmp_path / "signatures").mkdir()
    (tmp_path / "signatures" / "a.toml").write_text(
        '[[signature]]\nid = "written"\nphases = ["vector"]\npattern = "deep in a log"\ncause = "deep"\n'
        'examples = ["deep in a log", "so deep in a log", "again: deep in a log"]\nremedy = { text = "dig" }\n'
    )
    monkeypatch.setenv(signature_files.VARIABLE, str(tmp_path / "signatures"))
    vector = phase(Phase.VECTOR, Outcome.FAILED, "silence", evidence="evidence/1")
    folder = tmp_path / "report"
    (folder / "evidence" / "1").mkdir(parents=True)
    (folder / "evidence" / "1" / "log.txt").write_text("so deep in a log")
    (folder / "report.json").write_bytes(document.encode(made(record(case("ppfp", vector=vector)))))

    assert main(["report", str(folder), "--diagnose", "--out", str(folder)]) == 1

    assert causes(document.read((folder / "report.json").read_bytes(), "r")) == [["written"]]
    assert "### `written`" in (folder / "report.md").read_text()
    assert (folder / "evidence" / "1" / "log.txt").read_text() == "so deep in a log"
    assert capsys.readouterr().err


def test_titles_roles_and_pages_come_from_the_matrix(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On the command line: a report of another time is brought to what its matrix says now, its page in words too."""
    committed = Path(__file__).parents[2] / "reports" / "kitchen" / "report.json"
    plain = json.loads(committed.read_text())
    plain["matrices"]["kitchen"].pop("title")
    for one in plain["cells"]:
        one.pop("role")
    (tmp_path / "report.json").write_text(json.dumps(plain))

    assert main(["report", str(tmp_path), "--diagnose", "--out", str(tmp_path / "new")]) == 0
    made = json.loads((tmp_path / "new" / "report.json").read_text())

    assert made["matrices"] == json.loads(committed.read_text())["matrices"]
    roles = {one["id"]: one["role"] for one in json.loads(committed.read_text())["cells"]}
    assert {one["id"]: one["role"] for one in made["cells"]} == roles
    assert {*roles.values()} == {"main", "variant", "what-if", "repair"}
    assert (tmp_path / "new" / "README.md").read_text() == committed.with_name("README.md").read_text()
    capsys.readouterr()

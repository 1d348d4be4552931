"""The report document: its keys, what it is made of, and that nothing is lost on the way."""

import json

import msgspec
import pytest
from builders import GENERATED, HERE, LETTERS, MACHINES, case, cell, entry, phase, record, step, warning
from specimens import RESET, XML, quick, quick_document

from harness.model import CheckRecord, Expectation, Level, Outcome, Phase, PhaseRecord, Plan, Verdict, replace
from harness.model.errors import BadInput
from harness.model.report_types import CellEntry, Document, FindingEntry
from harness.reports import document

CELL_KEYS = {
    "id", "matrix", "axes", "requested_python", "python", "machine", "environment", "supplied", "installed", "lock",
    "lock_sha256", "key", "measured", "reused", "inferred", "attempts", "seconds", "verdict", "unverified", "expected",
    "as_expected", "repairs", "findings", "phases", "cases", "decisive", "diagnoses", "evidence",
}  # fmt: skip
CASE_KEYS = {"case", "env", "api", "phases", "checks", "frames", "decisive"}


def test_keys_of_the_contract() -> None:
    """Every key that others rely on is there, in every cell and case."""
    plain = json.loads(document.encode(quick_document()))

    assert {"schema", "generated", "machines", "cells", "dropped"} <= plain.keys()
    assert plain["schema"] == 1
    for plain_cell in plain["cells"]:
        assert plain_cell.keys() >= CELL_KEYS
        assert list(plain_cell["phases"]) == sorted(["resolve", "install", "import", "single", "vector", "render"])
        for tried in plain_cell["cases"]:
            assert tried.keys() >= CASE_KEYS
    assert plain["dropped"][0] == {
        "id": "quick/py3.9_gymnasium-1.2.3_mujoco-2.3.7",
        "reason": "gymnasium 1.2 needs Python 3.10",
    }


def test_a_line_for_each_combination() -> None:
    """A change of one combination changes one line of the file."""
    whole = quick_document()
    first, *others = whole.cells
    changed = msgspec.structs.replace(whole, cells=(msgspec.structs.replace(first, seconds=987.0), *others))

    before, after = (document.encode(one).decode().splitlines() for one in (whole, changed))

    assert len(before) == len(after)
    assert sum(old != new for old, new in zip(before, after, strict=True)) == 1


@pytest.mark.parametrize(
    ("mark", "kept"), [("p", False), ("s", False), ("u", False), ("f", True), ("c", True), ("t", True)]
)
def test_only_failures_keep_their_texts_beside_the_report(mark: str, kept: bool) -> None:
    """A report names the texts of a phase that failed; what passed or was skipped lies in the pack."""
    measured = record(replace(case("pppp"), phases=(phase(Phase.VECTOR, LETTERS[mark], evidence="evidence/1"),)))

    (judged,) = document.build([measured], [Plan(matrix="quick", cells=(measured.cell,))], MACHINES, GENERATED).cells

    assert bool(judged.cases[0].evidence) is kept


def test_every_planned_cell_has_a_row() -> None:
    """A cell that was not measured is there, in the order of the plan, and says so."""
    plan, records = quick()

    cells = quick_document().cells

    assert [entry.id for entry in cells] == [planned.id for planned in plan.cells]
    (unrun,) = (entry for entry in cells if entry.id not in {made.cell.id for made in records})
    assert (unrun.verdict, unrun.as_expected, unrun.machine, unrun.installed) == (Verdict.NOT_RUN, None, HERE, None)


def test_two_machines() -> None:
    """A cell measured on two machines has a row for each; neither replaces the other."""
    here = record(case("pppp"))
    there = replace(here, machine="another", cases=(case("pfnn"),))
    plan = Plan(matrix="quick", cells=(here.cell,))

    made = document.build([here, there], [plan], {**MACHINES, "another": {}}, GENERATED)

    assert [(entry.machine, entry.verdict) for entry in made.cells] == [
        ("another", Verdict.BROKEN),
        (HERE, Verdict.WORKS),
    ]


def test_a_cell_in_full() -> None:
    """A cell tells what was asked, what was found, what hid it, and where the evidence is."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known", match="XML Error")
    vector = phase(Phase.VECTOR, Outcome.FAILED, XML, masked_by=RESET, evidence="evidence/v", attempts=2)
    single = phase(Phase.SINGLE, Outcome.PASSED, frames=("evidence/s/first.png",), evidence="evidence/s")
    made = record(
        case("ppfp", single=single, vector=vector),
        of=cell(expect=expect, environment={"MUJOCO_GL": "egl"}),
        supplied={"DISPLAY": "virtual"},
        lock="locks/a.txt",
        lock_sha256="a" * 64,
        key="k",
    )

    entry = document.build(
        [made], [Plan(matrix="quick", cells=(made.cell,))], MACHINES, GENERATED, lambda path: f"../../{path}"
    ).cells[0]

    assert (entry.verdict, entry.expected, entry.as_expected) == (Verdict.PARTIAL, Verdict.PARTIAL, True)
    assert (entry.decisive, entry.phase, entry.attempts, entry.seconds) == (XML, Phase.VECTOR, 2, 12.3)
    assert (entry.lock, entry.evidence) == ("../../locks/a.txt", "../../evidence/v")
    assert (entry.environment, entry.supplied) == ({"MUJOCO_GL": "egl"}, {"DISPLAY": "virtual"})
    tried = entry.cases[0]
    assert tried.checks == {
        "import.modules": "passed",
        "single.loop": "passed",
        "vector.sync": "failed",
        "render.rgb_array": "passed",
    }
    assert (tried.decisive, tried.reasons, tried.masked) == (XML, {"vector.sync": XML}, {"vector.sync": RESET})
    assert (tried.frames, tried.evidence) == (
        ("../../evidence/s/first.png",),
        {"vector": "../../evidence/v"},
    )


@pytest.mark.parametrize(
    ("said", "drawn"),
    [
        ({"api": "egl", "device": "software", "modules": ["mujoco"]}, {"api": "egl", "device": "software"}),
        ({"api": "x" * 400, "renderer": 3}, {"api": "x" * 300, "renderer": "3"}),
        ({"modules": ["pyglet"]}, {}),
        (["egl"], {}),
        ({}, {}),
    ],
)
def test_the_context_that_drew_is_described(said: object, drawn: dict[str, str]) -> None:
    """The context that drew is told of each case, as far as what the cell says of it can be used."""
    checks = (CheckRecord(check="render.rgb_array", outcome=Outcome.PASSED, facts={"gl": said}),)
    made = record(case("pppp", render=PhaseRecord(phase=Phase.RENDER, outcome=Outcome.PASSED, checks=checks)))

    assert entry(made).cases[0].drawn == drawn


def test_evidence_of_a_step() -> None:
    """The evidence of a cell that was not installed is the log of the step that failed."""
    made = record(install=step(Phase.INSTALL, Outcome.FAILED, "gcc"))

    assert entry(made).evidence == "evidence/install/log.txt"


def test_evidence_of_what_works() -> None:
    """The evidence of a working cell is that of the last phase that ran."""
    render = phase(Phase.RENDER, Outcome.PASSED, evidence="evidence/r")

    assert entry(record(case("pppp", render=render))).evidence == "evidence/r"


def test_a_case_that_could_not_be_verified_says_why() -> None:
    """The reason of an unavailable phase is the case's line, though the cell works."""
    seen = entry(record(case("pppu", render=phase(Phase.RENDER, Outcome.UNAVAILABLE, "no EGL here"))))

    assert (seen.decisive, seen.cases[0].decisive) == (None, "no EGL here")


def test_findings_once() -> None:
    """A finding made in two cases is one, with both; those of steps and of the cell come first."""
    found = warning("single.space", "outside")
    single = phase(Phase.SINGLE, Outcome.PASSED, findings=(found,))
    escaped = replace(found, check="resolve.cutoff", level=Level.NOTE, text="a file from find-links")
    made = record(case("pppp", single=single), case("pppp", "pusher", single=single), findings=(escaped,))

    assert entry(made).findings == (
        FindingEntry(check="resolve.cutoff", level=Level.NOTE, text="a file from find-links"),
        FindingEntry(check="single.space", level=Level.WARNING, text="outside", cases=("ant", "pusher")),
    )


def test_phases_cut_short_are_not_passed_over() -> None:
    """A phase that was asked for and left out is `not_reached` in the document."""
    left_out = PhaseRecord(phase=Phase.RENDER, outcome=Outcome.SKIPPED)

    seen = entry(record(case("pppp", render=left_out)))

    assert (seen.phases[Phase.RENDER], seen.cases[0].phases[Phase.RENDER]) == ("not_reached", "not_reached")


def test_round_trip() -> None:
    """A document reads back as it was written, and is written again to the same bytes."""
    made = quick_document()
    content = document.encode(made)

    again = document.read(content, "report.json")

    assert again == made
    assert document.encode(again) == content


def test_encoding_is_stable() -> None:
    """The order in which facts and versions came makes no other document."""
    plan, records = quick()
    turned = [
        replace(made, installed=dict(reversed((made.installed or {}).items())) if made.installed else None)
        for made in reversed(records)
    ]

    assert document.encode(document.build(turned, [plan], MACHINES, GENERATED)) == document.encode(quick_document())


def test_keys_of_a_later_version_are_passed_over() -> None:
    """A document with more keys than this version knows is read."""
    plain = json.loads(document.encode(quick_document()))
    plain["cells"][0]["colour"] = "red"

    assert document.read(json.dumps(plain).encode(), "report.json") == quick_document()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "r.json: line 1, column 2: expecting property name enclosed in double quotes"),
        (b"[]", "r.json: expected a table, got a list"),
        (b'{"schema": 2}', 'r.json: schema: unknown value "2"; valid: "1"'),
    ],
)
def test_a_file_that_is_no_report_is_refused(content: bytes, message: str) -> None:
    """A file that is no report is refused with its name and place."""
    with pytest.raises(BadInput) as caught:
        document.read(content, "r.json")

    assert str(caught.value) == message


def test_moved() -> None:
    """Moving a document renames every path in it and nothing else."""
    vector = phase(Phase.VECTOR, Outcome.FAILED, XML, evidence="v", frames=("f.png",))
    made = record(case("ppfp", vector=vector), lock="locks/a.txt")
    whole = document.build([made], [Plan(matrix="quick", cells=(made.cell,))], MACHINES, GENERATED)

    moved = document.relocate(whole, lambda path: f"x/{path}")

    entry, tried = moved.cells[0], moved.cells[0].cases[0]
    assert (entry.lock, entry.evidence, tried.frames, tried.evidence) == (
        "x/locks/a.txt",
        "x/v",
        ("x/f.png",),
        {"vector": "x/v"},
    )
    assert document.relocate(moved, lambda path: path.removeprefix("x/")) == whole


class TestCombined:
    def later(self, whole: Document, *cells: CellEntry) -> Document:
        return msgspec.structs.replace(whole, generated="2026-11-22T00:00:00Z", cells=cells)

    def test_later_measurement_stands(self) -> None:
        """Of a cell measured twice on one machine the later one is kept, whatever the order of the documents."""
        whole = quick_document()
        newer = msgspec.structs.replace(whole.cells[0], measured="2026-11-22T00:00:00Z", seconds=1.0)

        for documents in ([whole, self.later(whole, newer)], [self.later(whole, newer), whole]):
            made = document.combine(documents)
            assert {entry.id: entry for entry in made.cells}[newer.id] == newer
            assert (len(made.cells), made.generated) == (len(whole.cells), "2026-11-22T00:00:00Z")

    def test_not_run_gives_way(self) -> None:
        """A row that says `not run` disappears when another document has the cell measured."""
        whole = quick_document()
        unrun = msgspec.structs.replace(whole.cells[0], machine=None, measured=None, verdict=Verdict.NOT_RUN)

        assert document.combine([self.later(whole, unrun), whole]).cells[0].verdict is Verdict.WORKS

    def test_one_document(self) -> None:
        """A single document stays what it is."""
        assert document.combine([quick_document()]) == quick_document()


def test_stale_expectations_are_listed_and_fail() -> None:
    """Sentences on expectations out of date, of the plan and of cells, are in the document and make exit code 1."""
    made = record(case("pppp"), of=cell(expect=Expectation(verdict=Verdict.BROKEN, reason="known")))
    plan = Plan(matrix="quick", cells=(made.cell,), stale=("expect[1] matches no cell",))

    whole = document.build([made], [plan], MACHINES, GENERATED)

    assert whole.stale == (
        "expect[1] matches no cell",
        "quick/py3.11_gymnasium-1.2.3 does better than expected: works instead of broken",
    )
    assert document.exit_code(whole, ("unexpected", "stale")) == 1


def test_exit_code_of_what_is_as_expected() -> None:
    """Works, red as expected, unavailable and not run exit 0; unavailable does not where it is named."""
    plan, records = quick()
    fine = [made for made in records if entry(made).as_expected is not False]
    whole = document.build(fine, [plan], MACHINES, GENERATED)

    assert document.exit_code(whole, ("unexpected", "stale")) == 0
    assert document.exit_code(whole, ("unexpected", "stale", "unavailable")) == 1


def test_a_repaired_release_is_listed() -> None:
    """A repaired release is listed with its edits, their reason, and everything needed to build the same wheel."""
    cells = {cell.axes["mujoco"]: cell for cell in quick_document().cells if cell.axes["python"] == "3.9"}

    assert msgspec.to_builtins(cells["2.3.7"].repairs) == (
        {
            "package": "gymnasium",
            "version": "0.29.1",
            "edits": ({"field": "Requires-Dist", "from": "shimmy (>=1.)", "to": "shimmy (>=1)"},),
            "reason": "an extra requires what is no version",
            "link": "https://example.org/750",
            "sdist_sha256": "1" * 64,
            "wheel_sha256": "2" * 64,
            "build": ("setuptools==66.1.1",),
        },
    )
    assert cells["3.3.7"].repairs == ()

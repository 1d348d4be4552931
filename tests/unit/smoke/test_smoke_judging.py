"""From what was measured to what pytest is told."""

from __future__ import annotations

import builders
import pytest
from builders import CHECKS, make_knowledge, signature

from harness.judging.assess import assess
from harness.model import (
    Cell,
    CellRecord,
    CheckRecord,
    Expectation,
    Observation,
    Outcome,
    Phase,
    PhaseRecord,
    Step,
    Subject,
    Suite,
    Verdict,
    replace,
)
from harness.smoke import judging
from harness.smoke.judging import Kind, PhaseResult

CELL = builders.cell(id="m/c")
(CASE,) = CELL.cases
EVERYTHING = frozenset(Phase)
TODAY = "2026-11-21"


def expecting(verdict: str, phase: str | None = None, match: str | None = None, until: str | None = None) -> Cell:
    """Return the cell with an expectation."""
    expect = Expectation(
        verdict=Verdict(verdict), reason="known", phase=Phase(phase) if phase else None, match=match, until=until
    )
    return replace(CELL, expect=expect)


def record(cell: Cell = CELL, decisive: str | None = "boom", **outcomes: str) -> CellRecord:
    """Return an installed cell with a case whose phases ended as given; `import_`, since `import` is a keyword."""
    phases = {}
    for at in CHECKS:
        outcome = Outcome(outcomes.get(at.value, outcomes.get(f"{at.value}_", "passed")))
        line = None if outcome in {Outcome.PASSED, Outcome.NOT_REACHED} else decisive
        phases[at.value] = builders.phase(at, outcome, line, evidence=f"evidence/{at}", seconds=2.0)
    return builders.record(builders.case("pppp", CASE.id, **phases), of=cell, machine="here")


def item_result(record: CellRecord, phase: str, shown: frozenset[Phase] = EVERYTHING) -> tuple[Kind, str]:
    """Return the kind and the text with which the item of a phase ends."""
    ended = judging.judge_phase(record.cell, Phase(phase), judging.collect_phases(record), shown, TODAY)
    return ended.kind, ended.text


# --- phases ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        ("passed", (Kind.PASSED, "")),
        ("failed", (Kind.FAILED, "boom\nsingle.loop failed")),
        ("crashed", (Kind.FAILED, "boom\nsingle.loop crashed")),
        ("timed_out", (Kind.FAILED, "boom\nsingle.loop timed_out")),
        ("flaky", (Kind.FAILED, "boom\nsingle.loop flaky")),
        ("infra", (Kind.INCONCLUSIVE, "inconclusive: boom\nsingle.loop infra")),
        ("unavailable", (Kind.SKIPPED, "unavailable: boom")),
        ("skipped", (Kind.SKIPPED, "no meaning here: boom")),
    ],
)
def test_every_outcome_has_its_word(outcome: str, expected: tuple[Kind, str]) -> None:
    """A failure begins with its line, an inconclusive result with `inconclusive`, and a skip with its kind."""
    assert item_result(record(single=outcome), "single") == expected


def test_the_mask_of_a_failure_is_named() -> None:
    """Each check that did not pass is named, with its own line where that is another, and with what hides it."""
    checks = (
        CheckRecord(check="vector.sync", outcome=Outcome.PASSED),
        CheckRecord(check="vector.async.fork", outcome=Outcome.FAILED, decisive="BrokenPipe", masked_by="EOFError"),
        CheckRecord(check="vector.async.spawn", outcome=Outcome.CRASHED, decisive="SIGSEGV"),
    )
    cell = replace(CELL, cases=(replace(CASE, checks=tuple(check.check for check in checks)),))
    phase = PhaseRecord(phase=Phase.VECTOR, outcome=Outcome.FAILED, decisive="BrokenPipe", checks=checks)
    found = replace(record(cell), cases=(replace(record().cases[0], phases=(phase,)),))

    assert item_result(found, "vector")[1].splitlines() == [
        "BrokenPipe",
        "vector.async.fork failed",
        "vector.async.fork is hidden by: EOFError",
        "vector.async.spawn crashed: SIGSEGV",
    ]


STOPPED = {"single": "failed", "vector": "not_reached", "render": "not_reached"}


@pytest.mark.parametrize(
    ("cell", "shown", "expected"),
    [
        (CELL, EVERYTHING, (Kind.SKIPPED, "not reached: single failed")),
        (CELL, frozenset(), (Kind.FAILED, "not reached, single failed: boom\nsingle.loop failed")),
        (expecting("broken", "single"), frozenset(), (Kind.XFAILED, "not reached, single failed: boom (known)")),
        (expecting("broken", "render"), frozenset(), (Kind.FAILED, "not reached, single failed: boom\nsingle.loop failed")),  # noqa: E501
    ],
)  # fmt: skip
def test_an_obstacle_is_reported_once(cell: Cell, shown: frozenset[Phase], expected: tuple[Kind, str]) -> None:
    """The item of the failed phase reports it or, if that item is not in the session, the item that needs the phase."""
    assert item_result(record(cell, **STOPPED), "render", shown) == expected


@pytest.mark.parametrize("phase", ["install", "import", "render"])
@pytest.mark.parametrize(
    ("outcome", "shown", "expected"),
    [
        ("failed", EVERYTHING, (Kind.SKIPPED, "not reached: resolve failed")),
        ("failed", frozenset(), (Kind.FAILED, "not reached, resolve failed: no solution")),
        ("infra", frozenset(), (Kind.INCONCLUSIVE, "inconclusive: not reached, resolve infra: no solution")),
        ("timed_out", frozenset(), (Kind.INCONCLUSIVE, "inconclusive: not reached, resolve infra: no solution")),
        ("unavailable", EVERYTHING, (Kind.SKIPPED, "unavailable: no solution")),
    ],
)
def test_nothing_is_reached_without_a_lock(
    phase: str, outcome: str, shown: frozenset[Phase], expected: tuple[Kind, str]
) -> None:
    """A resolution that did not end well is the reason of all that comes after it."""
    step = Step(phase=Phase.RESOLVE, outcome=Outcome(outcome), decisive="no solution")
    found = record(import_="not_reached", single="not_reached", vector="not_reached", render="not_reached")

    assert item_result(replace(found, resolve=step, install=None), phase, shown) == expected


def test_a_cell_without_an_interpreter_is_skipped_everywhere() -> None:
    """Every phase of such a cell is skipped with the reason."""
    found = record(import_="not_reached", single="not_reached", vector="not_reached", render="not_reached")
    found = replace(found, resolve=None, install=None, unavailable="no Python 3.99")

    for phase in ("resolve", "install", "import", "render"):
        assert item_result(found, phase) == (Kind.SKIPPED, "unavailable: no Python 3.99")


# --- expectations ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "phase", "line", "expected"),
    [
        (expecting("partial"), "render", "boom", True),
        (expecting("partial"), "install", "boom", False),
        (expecting("uninstallable"), "install", "boom", True),
        (expecting("unresolvable"), "install", "boom", False),
        (expecting("import_fails"), "single", "boom", False),
        (expecting("works"), "single", "boom", False),
        (expecting("partial", "vector"), "vector", "boom", True),
        (expecting("partial", "vector"), "single", "boom", False),
        (expecting("partial", "vector"), "render", "boom", False),
        (expecting("partial", "vector", "bo+m"), "vector", "a boom", True),
        (expecting("partial", "vector", "bo+m"), "vector", "crash", False),
        (expecting("partial", "vector", "bo+m"), "vector", None, False),
        (expecting("partial", "vector", "bo+m"), "render", "a boom", True),
        (expecting("partial", "vector", "bo+m"), "single", "a boom", False),
        (expecting("partial", until=f"{TODAY}T23:59:59Z"), "render", "boom", True),
        (expecting("partial", until="2026-11-20T23:59:59Z"), "render", "boom", False),
    ],
)
def test_expected_failures_in_later_phases_are_foreseen(
    cell: Cell, phase: str, line: str | None, expected: bool
) -> None:
    """Those of the phase and line expected, and the same again in a later phase, as long as that is expected."""
    assert (
        judging.is_expected(
            cell.expect, judging.PhaseResult(phase=Phase(phase), outcome=Outcome.FAILED, line=line), TODAY
        )
        is expected
    )


def test_a_code_is_foreseen() -> None:
    """An expected code is matched with the cell's observation, in its own phase or seen again in a later one."""
    cell = replace(CELL, expect=Expectation(verdict=Verdict.PARTIAL, reason="known", phase=Phase.VECTOR, code="more"))
    for phase, code, expected in (("vector", "more", True), ("vector", "raised", False), ("render", "more", True)):
        observed = Observation(check="x", code=code)
        at = judging.PhaseResult(phase=Phase(phase), outcome=Outcome.FAILED, line="other words", observed=observed)
        assert judging.is_expected(cell.expect, at, TODAY) is expected


@pytest.mark.parametrize(
    ("found", "kind", "text"),
    [
        (record(), Kind.PASSED, ""),
        (record(render="failed"), Kind.FAILED, "partial in render: boom\nexpected: works"),
        (record(expecting("partial", "render"), render="failed"), Kind.XFAILED, "partial in render: known"),
        (
            record(expecting("broken", "render", "x+"), render="failed"),
            Kind.FAILED,
            "[XPASS(strict)] m/c does better than expected: partial instead of broken (known)",
        ),
        (
            record(expecting("partial", "vector", "x+"), render="failed"),
            Kind.FAILED,
            "partial in render: boom\nexpected: partial in vector, its line matching 'x+' (known)",
        ),
        (
            record(expecting("partial", "render", until="2020-01-01"), render="failed"),
            Kind.FAILED,
            "m/c was expected to be partial until 2020-01-01, which has passed (known)",
        ),
        (
            record(expecting("partial")),
            Kind.FAILED,
            "[XPASS(strict)] m/c does better than expected: works instead of partial (known)",
        ),
        (record(render="infra"), Kind.INCONCLUSIVE, "inconclusive in render: boom"),
        (
            replace(record(single="not_reached"), resolve=None, install=None, unavailable="no Python"),
            Kind.SKIPPED,
            "unavailable: no Python",
        ),
        (replace(record(), resolve=None, install=None), Kind.SKIPPED, "not run: only the import was tried"),
    ],
)
def test_the_verdict_of_a_cell(found: CellRecord, kind: Kind, text: str) -> None:
    """An unexpected verdict fails, better ones too; what could not be told fails; what is not here is skipped."""
    ended = judging.judge_cell(assess(found, today=TODAY))

    assert (ended.kind, ended.text) == (kind, text)


def test_the_verdict_of_a_cell_that_fails_in_a_known_way() -> None:
    """The failure is expected if its cause is the named one, not another."""
    expect = Expectation(verdict=Verdict.PARTIAL, reason="known", signature="it")
    found = record(replace(CELL, expect=expect), render="failed")
    same, other = (
        judging.judge_cell(assess(found, make_knowledge(signature(name, "boom")))) for name in ("it", "that")
    )
    assert (same.kind, same.text) == (Kind.XFAILED, "partial in render: known")
    assert (other.kind, other.text) == (
        Kind.FAILED,
        "partial in render: boom\nexpected: partial, known as it (known)",
    )


def test_needed_phases_come_nearest_first() -> None:
    """Rendering needs a loop, a loop needs an import."""
    assert judging.needs(Phase.RENDER) == (Phase.SINGLE, Phase.IMPORT)


SUITE = PhaseRecord(phase=Phase.SUITE, outcome=Outcome.FAILED, decisive="test_it: assert 0", evidence="evidence/suite")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (replace(record(), suite=SUITE), (Kind.FAILED, "test_it: assert 0")),
        (replace(record(), suite=replace(SUITE, outcome=Outcome.INFRA)), (Kind.INCONCLUSIVE, "inconclusive: test_it: assert 0")),  # noqa: E501
        (record(import_="failed", single="not_reached"), (Kind.SKIPPED, "not reached: import failed")),
    ],
)  # fmt: skip
def test_the_suite_of_a_subject_needs_an_import(found: CellRecord, expected: tuple[Kind, str]) -> None:
    """The suite is skipped as not reached if no case could be imported."""
    subject = Subject(source=".", state="s", suite=Suite())
    found = replace(found, cell=replace(CELL, subject=subject))
    ended = judging.judge_phase(found.cell, Phase.SUITE, judging.collect_suite(found), EVERYTHING, TODAY)

    assert (ended.kind, ended.text) == expected


def test_a_suite_without_an_environment_says_why() -> None:
    """Its item fails as one that could not be told, with the reason; the verdict's item is that of the cases."""
    cell = replace(CELL, subject=Subject(source=".", suite=Suite()))
    suite = PhaseRecord(phase=Phase.SUITE, outcome=Outcome.NOT_REACHED, decisive="no swig")
    found = replace(record(cell), suite=suite)

    ended = judging.judge_phase(cell, Phase.SUITE, judging.collect_suite(found), EVERYTHING, TODAY)

    assert (ended.kind, ended.text) == (Kind.INCONCLUSIVE, "inconclusive: not run: no swig")
    assert judging.judge_cell(assess(found, today=TODAY)).kind is Kind.PASSED


def test_time_is_that_of_this_session() -> None:
    """A reused phase took no time."""
    (case,) = record().cases
    phases = tuple(replace(phase, reused=phase.phase is Phase.RENDER) for phase in case.phases)
    found = judging.collect_phases(replace(record(), cases=(replace(case, phases=phases),)))

    assert (found[Phase.SINGLE].seconds, found[Phase.RENDER].seconds) == (2.0, 0.0)
    assert isinstance(found[Phase.RESOLVE], PhaseResult)


def misleading(cell: Cell = CELL) -> CellRecord:
    """Return a cell whose picture was drawn by a camera that looks elsewhere."""
    seen = builders.case("pppp", CASE.id, render=builders.render_phase(Outcome.FAILED))
    return builders.record(seen, of=cell)


def test_a_case_that_misleads_has_not_passed() -> None:
    """Its item fails by the line of the check, though the phase passed; where expected, it is an xfail."""
    expected = misleading(expecting("misleads", "render", "elsewhere"))

    assert item_result(misleading(), "render") == (
        Kind.FAILED,
        "misleads: looks elsewhere\nrender.camera failed",
    )
    assert item_result(misleading(), "single")[0] is Kind.PASSED
    assert judging.judge_cell(assess(misleading())).kind is Kind.FAILED
    assert item_result(expected, "render")[0] is Kind.XFAILED
    assert judging.judge_cell(assess(expected)).kind is Kind.XFAILED

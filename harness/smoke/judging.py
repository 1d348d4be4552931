"""Turn measured records into outcomes for pytest: pure functions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from harness.judging.assess import Assessed, assess
from harness.judging.counted_phases import find_observation, reason, step_outcome, suite_phase
from harness.judging.expectation import is_over, matches_line
from harness.judging.runs import misleading
from harness.judging.runs.check import NEEDS
from harness.model import (
    CASE_PHASES,
    Cell,
    CellRecord,
    Expectation,
    Observation,
    Outcome,
    Phase,
    PhaseRecord,
    Verdict,
    replace,
)

POSSIBLE: Mapping[Verdict, frozenset[Phase]] = {
    Verdict.UNRESOLVABLE: frozenset({Phase.RESOLVE}),
    Verdict.UNINSTALLABLE: frozenset({Phase.INSTALL}),
    Verdict.IMPORT_FAILS: frozenset({Phase.IMPORT}),
    Verdict.MISLEADS: frozenset({*CASE_PHASES, Phase.SUITE}),
    Verdict.PARTIAL: frozenset({*CASE_PHASES, Phase.SUITE}),
    Verdict.BROKEN: frozenset({*CASE_PHASES, Phase.SUITE}),
}
"""Where a cell fails that is expected to have this verdict; the others fail nowhere."""


class Kind(StrEnum):
    """The outcome of an item in pytest's words; `inconclusive` fails, and its text says so first."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    XFAILED = "xfailed"
    SKIPPED = "skipped"


@dataclass(frozen=True, kw_only=True, slots=True)
class ItemOutcome:
    """The outcome of one item: the first line of `text` says why, `evidence` is a path below the state folder."""

    kind: Kind
    text: str = ""
    evidence: str | None = None
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseResult:
    """One phase as it was measured: of a case, or of the whole cell (resolve, install)."""

    phase: Phase
    outcome: Outcome
    line: str | None = None
    more: tuple[str, ...] = ()
    evidence: str | None = None
    seconds: float = 0.0
    observed: Observation | None = None


def collect_phases(record: CellRecord) -> dict[Phase, PhaseResult]:
    """Return the phases that were tried or that block others, from a record of one case or none."""
    phases: dict[Phase, PhaseResult] = {}
    for step in (record.resolve, record.install):
        if step:
            outcome = step_outcome(step) or step.outcome
            seconds = 0.0 if step.reused else step.seconds
            phases[step.phase] = PhaseResult(
                phase=step.phase, outcome=outcome, line=step.decisive, evidence=step.log, seconds=seconds
            )
    if record.unavailable:
        at = Phase.INSTALL if record.resolve else Phase.RESOLVE
        phases[at] = PhaseResult(phase=at, outcome=Outcome.UNAVAILABLE, line=record.unavailable)
    for case in assess(record).cases:
        phases |= {phase.phase: _convert_phase(phase) for phase in case.phases}
    return phases


def collect_suite(record: CellRecord) -> dict[Phase, PhaseResult]:
    """Return the suite of a cell's subject and the phases that block it. Import blocks it if all cases fail it."""
    phases = collect_phases(replace(record, cases=()))
    suite = suite_phase(record)
    imports = [at for case in record.cases if (at := collect_phases(replace(record, cases=(case,))).get(Phase.IMPORT))]
    if imports:
        phases[Phase.IMPORT] = next((at for at in imports if at.outcome is Outcome.PASSED), imports[0])
    return phases | ({Phase.SUITE: _convert_phase(suite)} if suite else {})


def judge_phase(
    cell: Cell, phase: Phase, phases: Mapping[Phase, PhaseResult], shown: frozenset[Phase], today: str
) -> ItemOutcome:
    """Return the outcome of a phase's item. `shown` are the phases with items of their own in this session.

    A phase that was not reached is skipped if the phase that blocks it is shown; else it reports that phase's outcome.
    """
    here = phases.get(phase)
    if here is not None and here.outcome is not Outcome.NOT_REACHED:
        return _judge_result(cell, here, today)
    # A suite that got no environment has a reason of its own, and no phase before it is to blame.
    if here is not None and here.line:
        return ItemOutcome(kind=Kind.INCONCLUSIVE, text=f"inconclusive: not run: {here.line}", evidence=here.evidence)
    way = _find_blocker(phase, phases)
    if way is None:
        return ItemOutcome(kind=Kind.INCONCLUSIVE, text="inconclusive: it was not reached, for an unknown reason")
    if way.outcome is Outcome.UNAVAILABLE:
        return _judge_result(cell, way, today)
    if way.phase in shown:
        return ItemOutcome(kind=Kind.SKIPPED, text=f"not reached: {way.phase} {way.outcome}")
    blocker_outcome = _judge_result(cell, way, today)
    lead = "inconclusive: " if blocker_outcome.kind is Kind.INCONCLUSIVE else ""
    text = f"{lead}not reached, {way.phase} {way.outcome}: {blocker_outcome.text.removeprefix(lead)}"
    return ItemOutcome(kind=blocker_outcome.kind, text=text, evidence=blocker_outcome.evidence)


def judge_cell(assessment: Assessed) -> ItemOutcome:
    """Return the outcome of the item of a cell's verdict: an expected failure is a strict xfail."""
    right, stale = assessment.as_expected, assessment.stale
    where = f" in {assessment.phase}" if assessment.phase else ""
    summary = f"{assessment.verdict}{where}"
    line = f": {assessment.decisive}" if assessment.decisive else ""
    match assessment.verdict:
        case Verdict.INCONCLUSIVE:
            return ItemOutcome(kind=Kind.INCONCLUSIVE, text=f"inconclusive{where}{line}")
        case Verdict.UNAVAILABLE | Verdict.NOT_RUN:
            return ItemOutcome(kind=Kind.SKIPPED, text=f"{assessment.verdict.replace('_', ' ')}{line}")
        case _:
            expect = assessment.record.cell.expect
    if stale:
        strict = "[XPASS(strict)] " if right is False else ""
        return ItemOutcome(kind=Kind.FAILED, text=f"{strict}{stale} ({expect.reason})" if expect else stale)
    if right and expect and assessment.verdict is not Verdict.WORKS:
        return ItemOutcome(kind=Kind.XFAILED, text=f"{summary}: {expect.reason}")
    if right:
        return ItemOutcome(kind=Kind.PASSED)
    return ItemOutcome(kind=Kind.FAILED, text=f"{summary}{line}\nexpected: {_expected(expect)}")


def needs(phase: Phase) -> tuple[Phase, ...]:
    """Return the phases of a case that this one needs, the nearest first."""
    needed = Phase.IMPORT if phase is Phase.SUITE else NEEDS.get(phase)
    return (needed, *needs(needed)) if needed else ()


def is_expected(expect: Expectation | None, at: PhaseResult, today: str) -> bool:
    """Return whether a failure is the expected one, or the same one again in a later phase. After `until`, none is."""
    if expect is None or is_over(expect, today) or at.phase not in POSSIBLE.get(expect.verdict, frozenset()):
        return False
    fits = matches_line(expect, at.line, at.observed)
    if expect.phase in {None, at.phase}:
        return fits
    order = list(Phase)
    # Only a line or a code can tell that a failure in a later phase is the same one.
    is_specific = expect.match is not None or expect.code is not None
    return is_specific and fits and expect.phase is not None and order.index(at.phase) > order.index(expect.phase)


def _convert_phase(record: PhaseRecord) -> PhaseResult:
    """Return a phase as its item reports it. A phase that passed but misleads counts as failed."""
    shown = misleading.find(record.checks) if record.outcome is Outcome.PASSED else ()
    reasons = tuple(check.decisive for check in shown)
    why = reasons[0] if reasons else reason(record)
    line = f"misleads: {why}" if reasons else why
    lines = []
    for check in (one for one in record.checks if one.outcome not in {Outcome.PASSED, Outcome.SKIPPED}):
        further = f": {check.decisive}" if check.decisive and check.decisive not in {line, *reasons} else ""
        lines.append(f"{check.check} {check.outcome}{further}")
        lines += [f"{check.check} is hidden by: {check.masked_by}"] if check.masked_by else []
    return PhaseResult(
        phase=record.phase,
        outcome=Outcome.FAILED if shown else record.outcome,
        line=line,
        observed=find_observation(record, why),
        more=tuple(lines),
        evidence=record.evidence,
        seconds=0.0 if record.reused else record.seconds,
    )


def _judge_result(cell: Cell, at: PhaseResult, today: str) -> ItemOutcome:
    """Return the outcome that a measured phase means for its item."""
    line = at.line or f"{at.phase} {at.outcome}"
    match at.outcome:
        case Outcome.PASSED:
            kind, text = Kind.PASSED, ""
        case Outcome.SKIPPED:
            kind, text = Kind.SKIPPED, f"no meaning here: {line}"
        case Outcome.UNAVAILABLE:
            kind, text = Kind.SKIPPED, f"unavailable: {line}"
        case Outcome.INFRA | Outcome.NOT_REACHED:
            kind, text = Kind.INCONCLUSIVE, "\n".join((f"inconclusive: {line}", *at.more))
        case Outcome.FAILED | Outcome.CRASHED | Outcome.TIMED_OUT | Outcome.FLAKY:
            kind, text = Kind.FAILED, "\n".join((line, *at.more))
            if cell.expect and is_expected(cell.expect, at, today):
                kind, text = Kind.XFAILED, f"{line} ({cell.expect.reason})"
    return ItemOutcome(kind=kind, text=text, evidence=at.evidence, seconds=at.seconds)


def _find_blocker(phase: Phase, phases: Mapping[Phase, PhaseResult]) -> PhaseResult | None:
    """Return the phase that blocks this one, if any: a step of the cell first, then the nearest phase it needs."""
    for step in (Phase.RESOLVE, Phase.INSTALL):
        if step is not phase and step in phases and phases[step].outcome is not Outcome.PASSED:
            return phases[step]
    before = [phases[needed] for needed in needs(phase) if needed in phases]
    stopped = [at for at in before if at.outcome not in {Outcome.PASSED, Outcome.NOT_REACHED}]
    # A failed phase explains more than a nearer one that was only skipped.
    return min(stopped, key=lambda at: at.outcome is Outcome.SKIPPED, default=None)


def _expected(expect: Expectation | None) -> str:
    if expect is None:
        return Verdict.WORKS
    where = f" in {expect.phase}" if expect.phase else ""
    match = f", its line matching {expect.match!r}" if expect.match else ""
    match += f", observed {expect.code}" if expect.code else ""
    signature = f", known as {expect.signature}" if expect.signature else ""
    return f"{expect.verdict}{where}{match}{signature} ({expect.reason})"

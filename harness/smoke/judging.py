"""Turn measured records into outcomes for pytest: pure functions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from harness.judging.assess import Assessed, assess
from harness.judging.counted_phases import observed, reason, step_outcome, suite_phase
from harness.judging.expectation import passed, says
from harness.judging.runs import misleading
from harness.judging.runs.check import NEEDS
from harness.model import CASE_PHASES, Cell, CellRecord, Expectation, Observed, Outcome, Phase, PhaseRecord, Verdict

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
class Ended:
    """The outcome of one item: the first line of `text` says why, `evidence` is a path below the state folder."""

    kind: Kind
    text: str = ""
    evidence: str | None = None
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Seen:
    """One phase as it was measured: of a case, or of the whole cell (resolve, install)."""

    phase: Phase
    outcome: Outcome
    line: str | None = None
    more: tuple[str, ...] = ()
    evidence: str | None = None
    seconds: float = 0.0
    observed: Observed | None = None


def seen(record: CellRecord) -> dict[Phase, Seen]:
    """Return the phases that were tried or that block others, from a record of one case or none."""
    found: dict[Phase, Seen] = {}
    for step in (record.resolve, record.install):
        if step:
            outcome = step_outcome(step) or step.outcome
            seconds = 0.0 if step.reused else step.seconds
            found[step.phase] = Seen(
                phase=step.phase, outcome=outcome, line=step.decisive, evidence=step.log, seconds=seconds
            )
    if record.unavailable:
        at = Phase.INSTALL if record.resolve else Phase.RESOLVE
        found[at] = Seen(phase=at, outcome=Outcome.UNAVAILABLE, line=record.unavailable)
    for case in assess(record).cases:
        found |= {phase.phase: _probed(phase) for phase in case.phases}
    return found


def suite_seen(record: CellRecord) -> dict[Phase, Seen]:
    """Return the suite of a cell's subject and the phases that block it. Import blocks it if all cases fail it."""
    found = seen(replace(record, cases=()))
    suite = suite_phase(record)
    imports = [at for case in record.cases if (at := seen(replace(record, cases=(case,))).get(Phase.IMPORT))]
    if imports:
        found[Phase.IMPORT] = next((at for at in imports if at.outcome is Outcome.PASSED), imports[0])
    return found | ({Phase.SUITE: _probed(suite)} if suite else {})


def ended(cell: Cell, phase: Phase, found: Mapping[Phase, Seen], shown: frozenset[Phase], today: str) -> Ended:
    """Return the outcome of a phase's item. `shown` are the phases with items of their own in this session.

    A phase that was not reached is skipped if the phase that blocks it is shown; else it reports that phase's outcome.
    """
    here = found.get(phase)
    if here is not None and here.outcome is not Outcome.NOT_REACHED:
        return _told(cell, here, today)
    if here is not None and here.line:
        return Ended(kind=Kind.INCONCLUSIVE, text=f"inconclusive: not run: {here.line}", evidence=here.evidence)
    way = _in_the_way(phase, found)
    if way is None:
        return Ended(kind=Kind.INCONCLUSIVE, text="inconclusive: it was not reached, and nothing says why")
    if way.outcome is Outcome.UNAVAILABLE:
        return _told(cell, way, today)
    if way.phase in shown:
        return Ended(kind=Kind.SKIPPED, text=f"not reached: {way.phase} {way.outcome}")
    told = _told(cell, way, today)
    lead = "inconclusive: " if told.kind is Kind.INCONCLUSIVE else ""
    text = f"{lead}not reached, {way.phase} {way.outcome}: {told.text.removeprefix(lead)}"
    return Ended(kind=told.kind, text=text, evidence=told.evidence)


def judged(found: Assessed) -> Ended:
    """Return the outcome of the item of a cell's verdict: an expected failure is a strict xfail."""
    right, stale = found.as_expected, found.stale
    where = f" in {found.phase}" if found.phase else ""
    told = f"{found.verdict}{where}"
    line = f": {found.decisive}" if found.decisive else ""
    match found.verdict:
        case Verdict.INCONCLUSIVE:
            return Ended(kind=Kind.INCONCLUSIVE, text=f"inconclusive{where}{line}")
        case Verdict.UNAVAILABLE | Verdict.NOT_RUN:
            return Ended(kind=Kind.SKIPPED, text=f"{found.verdict.replace('_', ' ')}{line}")
        case _:
            expect = found.record.cell.expect
    if stale:
        strict = "[XPASS(strict)] " if right is False else ""
        return Ended(kind=Kind.FAILED, text=f"{strict}{stale} ({expect.reason})" if expect else stale)
    if right and expect and found.verdict is not Verdict.WORKS:
        return Ended(kind=Kind.XFAILED, text=f"{told}: {expect.reason}")
    if right:
        return Ended(kind=Kind.PASSED)
    return Ended(kind=Kind.FAILED, text=f"{told}{line}\nexpected: {_expected(expect)}")


def needs(phase: Phase) -> tuple[Phase, ...]:
    """Return the phases of a case that this one needs, the nearest first."""
    needed = Phase.IMPORT if phase is Phase.SUITE else NEEDS.get(phase)
    return (needed, *needs(needed)) if needed else ()


def foreseen(expect: Expectation | None, at: Seen, today: str) -> bool:
    """Return whether a failure is the expected one, or the same one again in a later phase. After `until`, none is."""
    if expect is None or passed(expect, today) or at.phase not in POSSIBLE.get(expect.verdict, frozenset()):
        return False
    fits = says(expect, at.line, at.observed)
    if expect.phase in {None, at.phase}:
        return fits
    order = list(Phase)
    told = expect.match is not None or expect.code is not None
    return told and fits and expect.phase is not None and order.index(at.phase) > order.index(expect.phase)


def _probed(record: PhaseRecord) -> Seen:
    """Return a phase as its item reports it. A phase that passed but misleads counts as failed."""
    shown = misleading.shown(record.checks) if record.outcome is Outcome.PASSED else ()
    told = tuple(check.decisive for check in shown)
    why = told[0] if told else reason(record)
    line = f"misleads: {why}" if told else why
    lines = []
    for check in (one for one in record.checks if one.outcome not in {Outcome.PASSED, Outcome.SKIPPED}):
        further = f": {check.decisive}" if check.decisive and check.decisive not in {line, *told} else ""
        lines.append(f"{check.check} {check.outcome}{further}")
        lines += [f"{check.check} is hidden by: {check.masked_by}"] if check.masked_by else []
    return Seen(
        phase=record.phase,
        outcome=Outcome.FAILED if shown else record.outcome,
        line=line,
        observed=observed(record, why),
        more=tuple(lines),
        evidence=record.evidence,
        seconds=0.0 if record.reused else record.seconds,
    )


def _told(cell: Cell, at: Seen, today: str) -> Ended:
    """Return the outcome that a measured phase means for its item."""
    line = at.line or f"{at.phase} {at.outcome}"
    match at.outcome:
        case Outcome.PASSED:
            return Ended(kind=Kind.PASSED, evidence=at.evidence, seconds=at.seconds)
        case Outcome.SKIPPED:
            return Ended(kind=Kind.SKIPPED, text=f"no meaning here: {line}", seconds=at.seconds)
        case Outcome.UNAVAILABLE:
            return Ended(kind=Kind.SKIPPED, text=f"unavailable: {line}", seconds=at.seconds)
        case Outcome.INFRA | Outcome.NOT_REACHED:
            kind, line = Kind.INCONCLUSIVE, f"inconclusive: {line}"
        case Outcome.FAILED | Outcome.CRASHED | Outcome.TIMED_OUT | Outcome.FLAKY:
            if cell.expect and foreseen(cell.expect, at, today):
                return Ended(
                    kind=Kind.XFAILED, text=f"{line} ({cell.expect.reason})", evidence=at.evidence, seconds=at.seconds
                )
            kind = Kind.FAILED
    return Ended(kind=kind, text="\n".join((line, *at.more)), evidence=at.evidence, seconds=at.seconds)


def _in_the_way(phase: Phase, found: Mapping[Phase, Seen]) -> Seen | None:
    """Return the phase that blocks this one, if any: a step of the cell first, then the nearest phase it needs."""
    for step in (Phase.RESOLVE, Phase.INSTALL):
        if step is not phase and step in found and found[step].outcome is not Outcome.PASSED:
            return found[step]
    before = [found[needed] for needed in needs(phase) if needed in found]
    stopped = [at for at in before if at.outcome not in {Outcome.PASSED, Outcome.NOT_REACHED}]
    return min(stopped, key=lambda at: at.outcome is Outcome.SKIPPED, default=None)


def _expected(expect: Expectation | None) -> str:
    if expect is None:
        return Verdict.WORKS
    where = f" in {expect.phase}" if expect.phase else ""
    match = f", its line matching {expect.match!r}" if expect.match else ""
    match += f", observed {expect.code}" if expect.code else ""
    known = f", known as {expect.signature}" if expect.signature else ""
    return f"{expect.verdict}{where}{match}{known} ({expect.reason})"

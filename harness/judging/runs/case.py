"""Fold the probe runs of a case into its phases. All of it is pure.

while request := todo(asked, folded):
    folded = after(asked, folded, the reading of one more run)
phases(asked, folded)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from harness.judging.runs import misleading
from harness.judging.runs.check import phase_of
from harness.judging.runs.fold import ACROSS, LOOP, REPEAT, RUNS_TO_CONFIRM, CasePlan, Folded, fold, wanted_of
from harness.model import (
    CASE_PHASES,
    FAILING,
    Case,
    CaseRecord,
    CheckRecord,
    Finding,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    replace,
    worst,
)
from harness.model.vocabulary import MISLEADING
from harness.probes.evidence import Reading

BULKY = frozenset({"trajectory", "values", "pictures"})
"""Facts of a check that stay with its evidence."""


def phases(case_plan: CasePlan, folded: Folded, new: frozenset[str] = frozenset()) -> dict[Phase, PhaseRecord]:
    """Return the record of each phase of a case. `new` names the runs that were not made before."""
    return {
        phase: _phase(phase, names, folded, new)
        for phase, names in case_plan.wanted.items()
        if names and names[0] in folded.ended
    }


def case_record(case: Case, records: Mapping[Phase, PhaseRecord], runs: tuple[str, ...] = ()) -> CaseRecord:
    """Return the record of a case. Phases without a record are not reached, or skipped if not asked for."""
    wanted = wanted_of(case.checks, CASE_PHASES[-1])
    absent = {phase: Outcome.NOT_REACHED if phase in wanted else Outcome.SKIPPED for phase in CASE_PHASES}
    return CaseRecord(
        case=case.id,
        env=case.env,
        api=case.api,
        required=case.required,
        phases=tuple(records.get(phase) or PhaseRecord(phase=phase, outcome=absent[phase]) for phase in CASE_PHASES),
        runs=runs,
    )


def judged_again(case: Case, readings: Iterable[Reading]) -> CaseRecord:
    """Return the record of a case by these runs alone, whatever in-cell program they ran last."""
    runs = tuple(readings)
    program = {check: digest for reading in runs for check, digest in reading.run.program.items()}
    case_plan = CasePlan(case=case, wanted=wanted_of(case.checks, CASE_PHASES[-1]), program=program)
    folded = fold(case_plan, runs)
    return case_record(case, phases(case_plan, folded), folded.runs)


def _phase(phase: Phase, names: tuple[str, ...], folded: Folded, new: frozenset[str]) -> PhaseRecord:
    comparisons = [name for name in folded.ended if name in MISLEADING and phase_of(name) is phase]
    ended = [folded.ended[name] for name in (*names, *comparisons) if name in folded.ended]
    records = [one.confirmed() for one in ended]
    counting = misleading.deciding_checks(records)
    outcome = worst(record.outcome for record in counting)
    pairs = list(zip(ended, records, strict=True))
    deciding, line = next(
        ((one, record) for one, record in pairs if record in counting and record.outcome is outcome), pairs[0]
    )
    return PhaseRecord(
        phase=phase,
        outcome=outcome,
        seconds=round(sum(record.seconds for record in records), 3),
        decisive=line.decisive if line in counting else None,
        checks=tuple(
            replace(one, facts={name: one.facts[name] for name in one.facts if name not in BULKY}) for one in records
        ),
        findings=tuple({(one.check, one.text): one for one in _findings(phase, names, folded)}.values()),
        frames=tuple(picture for one in ended for picture in one.frames),
        evidence=deciding.folder,
        attempts=max(RUNS_TO_CONFIRM if any(one.passed_again) else one.attempts for one in ended),
        measured=max(one.measured for one in ended),
        peak_mb=max((one.peak_mb for one in ended if one.peak_mb), default=None),
        reused=not any(one.reading in new for one in ended),
    )


def _findings(phase: Phase, names: tuple[str, ...], folded: Folded) -> Iterable[Finding]:
    """Yield the findings of a phase: those made during checks that ended in the same run, and those on that run."""
    counting: dict[str, set[str | None]] = {}
    for check, run in [*((check, ended.reading) for check, ended in folded.ended.items()), *folded.followed.items()]:
        counting.setdefault(run, {None}).add(check)
    for reading, pairs in folded.findings.items():
        findings = (one for during, one in pairs if during in counting.get(reading, ()))
        yield from (one for one in findings if one.check.partition(".")[0] == phase)
    loop, repeat = folded.ended.get(LOOP), folded.ended.get(REPEAT)
    if loop and repeat and LOOP in names and loop.record.outcome is Outcome.PASSED:
        yield from _compare(loop.record, repeat.record)


def _compare(loop: CheckRecord, repeat: CheckRecord) -> Iterable[Finding]:
    """Yield a finding if the same seed gave another trajectory in a second process, or the loop failed there."""
    first, second = loop.facts.get("trajectory"), repeat.facts.get("trajectory")
    if repeat.outcome in FAILING:
        text = f"the same loop in a second process: {repeat.decisive}"
    elif repeat.outcome is Outcome.PASSED and first != second:
        text = f"the same seed gives another trajectory in another process{_first_difference(first, second)}"
    else:
        return
    yield Finding(check=ACROSS, level=Level.WARNING, text=text)


def _first_difference(first: object, second: object) -> str:
    if not isinstance(first, list) or not isinstance(second, list):
        return ""
    steps = [n for n, (one, other) in enumerate(zip(first, second, strict=False)) if one != other]
    return f", from step {steps[0]} on" if steps else ""

"""Try other ways to draw: cases that failed under settings that we supplied are tried under the other settings, too."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from harness.judging.runs.check import DRAWING, phase_of
from harness.machine import this_machine
from harness.model import (
    FAILING,
    Case,
    CaseRecord,
    CellRecord,
    Finding,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    replace,
)
from harness.running import case_run

Around = Callable[[CellRecord], case_run.Context]
"""Makes what the cases of a record share, with the settings that the record names as supplied."""


def due(record: CellRecord) -> tuple[Mapping[str, str], ...]:
    """Return the other settings under which to try the cases of a record; none if nothing failed by drawing."""
    if not any(_failed(case) for case in record.cases):
        return ()
    return this_machine.other_ways(record.supplied, record.cell.environment, record.installed or ())


def retry_drawing(record: CellRecord, cases: Iterable[Case], around: Around) -> CellRecord:
    """Return the record under the first other settings with which everything that failed to draw passes.

    If there are none, return the record as it is, with a note of the settings that were tried. Failed cases are tried
    first, and the rest only if they pass: a user has one set of settings for all of it.
    """
    all_cases, tried = tuple(cases), []
    for supplied in due(record):
        other = replace(record, supplied=supplied)
        context = around(other)
        phases = {case.case: _failed(case) for case in record.cases}
        # A generator: the first case that still fails ends the attempt, and the others are not run.
        again = (case_run.run_case(context, _only(case, phases[case.id])) for case in all_cases if phases.get(case.id))
        if all(not _fails(case) for case in again):
            case_records = tuple(case_run.run_case(context, case) for case in all_cases)
            if _no_worse(record.cases, case_records):
                return replace(other, cases=case_records)
        tried.append(" ".join(f"{name}={value}" for name, value in supplied.items()))
    if not tried:
        return record
    text = f"what failed to draw fails with {' and with '.join(tried)}, too"
    return replace(record, findings=(*record.findings, Finding(check="render.ways", level=Level.NOTE, text=text)))


def _failed(case: CaseRecord) -> frozenset[Phase]:
    """Return the phases in which a check failed that was about to draw."""
    return frozenset(
        phase.phase
        for phase in case.phases
        if any(check.outcome in FAILING and check.facts.get(DRAWING) for check in phase.checks)
    )


def _only(case: Case, phases: frozenset[Phase]) -> Case:
    wanted = phases | {Phase.IMPORT}
    return replace(case, checks=tuple(check for check in case.checks if phase_of(check) in wanted))


def _fails(case: CaseRecord) -> bool:
    ran = (phase.outcome for phase in case.phases if phase.checks)
    return any(outcome not in {Outcome.PASSED, Outcome.SKIPPED} for outcome in ran)


def _no_worse(before: Iterable[CaseRecord], after: Iterable[CaseRecord]) -> bool:
    """Tell whether each phase that passed still does."""
    by_phase = {(case.case, phase.phase): phase for case in after for phase in case.phases}
    return all(_passed(by_phase.get((case.case, one.phase))) for case in before for one in case.phases if _passed(one))


def _passed(phase: PhaseRecord | None) -> bool:
    return phase is not None and phase.outcome is Outcome.PASSED

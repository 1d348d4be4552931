"""Compute the phases of cases as they count: required findings fail them, and adapters' controls discount failures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from functools import cache

from harness.judging.discount import discount_phase
from harness.judging.runs import misleading
from harness.model import (
    CASE_PHASES,
    FAILING,
    CaseRecord,
    CellRecord,
    Level,
    Observation,
    Outcome,
    Phase,
    PhaseRecord,
    Step,
    replace,
)
from harness.model.vocabulary import MISLEADING

Cases = tuple[tuple[PhaseRecord, ...], ...]
"""The phases of each case as they count, all of `CASE_PHASES`."""


def step_outcome(step: Step | None) -> Outcome | None:
    """Return how a step on the host ended.

    A resolution or a build that timed out says nothing about packages: nobody tried it again with more time.
    """
    if step and step.outcome is Outcome.TIMED_OUT:
        return Outcome.INFRA
    return step.outcome if step else None


def reason(record: PhaseRecord) -> str | None:
    """Return why a phase ended as it did: its own line, or that of its first check that ended so."""
    own = (check.decisive for check in misleading.deciding_checks(record.checks) if check.outcome is record.outcome)
    return record.decisive or next((line for line in own if line), None)


def find_observation(record: PhaseRecord, line: str | None) -> Observation | None:
    """Return the cell's observation behind a line of a phase: of a check, or of a finding that the case requires."""
    checks = ((check.observed, check.decisive) for check in record.checks)
    findings = ((found.observed, f"{found.check}: {found.text}") for found in record.findings)
    return next((seen for seen, told in (*checks, *findings) if seen and line and told == line), None)


def suite_phase(evidence: CellRecord) -> PhaseRecord | None:
    """Return how the subject's own suite ended; None where the cell has none to run."""
    has_suite = evidence.cell.subject is not None and evidence.cell.subject.suite is not None
    return (evidence.suite or PhaseRecord(phase=Phase.SUITE, outcome=Outcome.NOT_REACHED)) if has_suite else None


def suite_not_run(suite: PhaseRecord) -> bool:
    """Return whether requested tests could not run because their environment could not be made."""
    return suite.outcome is Outcome.NOT_REACHED and suite.decisive is not None


ON_REQUEST = frozenset({Phase.BEHAVE, Phase.INTEROP})
"""Phases that a case has only where it asks for them."""


def counted_cases(evidence: CellRecord) -> Cases:
    """Return the phases of each recorded case, then those of each case of the cell that has no record."""
    recorded_ids = {record.case for record in evidence.cases}
    unseen = (
        CaseRecord(case=case.id, env=case.env, api=case.api, required=case.required, phases=())
        for case in evidence.cell.cases
        if case.id not in recorded_ids
    )
    return tuple(_case_phases(evidence, record) for record in (*evidence.cases, *unseen))


def _case_phases(evidence: CellRecord, record: CaseRecord) -> tuple[PhaseRecord, ...]:
    """Return the phases of a case as they count, all of `CASE_PHASES`; `required` findings fail them.

    A failure that the control of the adapter shares is `infra`: it is unknown whose fault it is.
    """
    records = {phase.phase: phase for phase in record.phases}
    cases = evidence.cell.cases
    checks_by_phase = _group_by_phase(tuple(check for case in cases if case.id == record.case for check in case.checks))
    counted = (
        _count_phase(phase, records.get(phase), checks_by_phase[phase], record.required) for phase in CASE_PHASES
    )
    return tuple(discount_phase(phase, evidence.controls.get(record.api)) for phase in counted)


@cache
def _group_by_phase(checks: tuple[str, ...]) -> Mapping[Phase, frozenset[str]]:
    return {phase: frozenset(one for one in checks if one.partition(".")[0] == phase) for phase in CASE_PHASES}


def counts(record: PhaseRecord) -> bool:
    """Return whether a phase is reported: always, except those that nobody asked for and that no case has unasked."""
    return record.phase not in ON_REQUEST or record.outcome is not Outcome.SKIPPED or bool(record.checks)


def effective(record: PhaseRecord, required: Iterable[str]) -> PhaseRecord:
    """Return the record of a phase, failed where a check that the case requires gave a warning."""
    names = frozenset(required)
    broken = [found for found in record.findings if found.check in names and found.level is Level.WARNING]
    if not broken or record.outcome in FAILING:
        return record
    return replace(record, outcome=Outcome.FAILED, decisive=f"{broken[0].check}: {broken[0].text}")


def _count_phase(phase: Phase, record: PhaseRecord | None, checks: Set[str], required: tuple[str, ...]) -> PhaseRecord:
    """Return a phase as it counts. If a requested check was left out, a phase that went well is not reached."""
    if record is None:
        return PhaseRecord(phase=phase, outcome=Outcome.NOT_REACHED if checks else Outcome.SKIPPED)
    effective_record = effective(record, required)
    left_out = checks - MISLEADING - {check.check for check in record.checks}
    if left_out and effective_record.outcome in {Outcome.PASSED, Outcome.SKIPPED}:
        return replace(effective_record, outcome=Outcome.NOT_REACHED)
    return effective_record

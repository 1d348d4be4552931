"""Say which probe run of a case is needed next: the rest after a death, a retry, a confirmation, a second process."""

from __future__ import annotations

from harness.judging.runs import misleading
from harness.judging.runs.check import phase_of, reachable
from harness.judging.runs.fold import LOOP, REPEAT, RUNS_TO_CONFIRM, CasePlan, Folded, has_passed
from harness.model import (
    FAILING,
    Outcome,
    Phase,
    worst,
)
from harness.probes import wire
from harness.probes.evidence import Request


def todo(case_plan: CasePlan, folded: Folded) -> Request | None:
    """Return the run that is needed next; None where the phases of the case are known."""
    if folded.again:
        return folded.again
    pending = _pending(case_plan, folded)
    if pending:
        batch = pending[:1] if case_plan.verify else pending
        limits = {check: _seconds(case_plan, folded, check) for check in batch}
        return Request(case=case_plan.case, limits=limits, followers=wire.followers_of(limits))
    confirmation = _confirmation(case_plan, folded) if case_plan.verify else None
    return confirmation or _following(case_plan, folded) or _comparison(case_plan, folded)


def _seconds(case_plan: CasePlan, folded: Folded, check: str) -> float:
    return case_plan.seconds(check) * (2 if check in folded.overran else 1)


def _pending(case_plan: CasePlan, folded: Folded) -> list[str]:
    outcomes: dict[Phase, Outcome] = {}
    for check, ended in folded.ended.items():
        phase = phase_of(check)
        check_outcomes = [one.outcome for one in misleading.deciding_checks([ended.record])]
        outcomes[phase] = worst((*check_outcomes, outcomes.get(phase, Outcome.PASSED)))
    return [check for check in case_plan.checks if check not in folded.ended and reachable(phase_of(check), outcomes)]


def _confirmation(case_plan: CasePlan, folded: Folded) -> Request | None:
    """Ask for one more run of a failed check: one that also passes is flaky."""
    for check, ended in folded.ended.items():
        again = len(ended.passed_again) < RUNS_TO_CONFIRM - 1
        if again and ended.record.outcome in FAILING and check in case_plan.checks:
            return Request(case=case_plan.case, limits={check: 2 * _seconds(case_plan, folded, check)}, confirms=True)
    return None


def _following(case_plan: CasePlan, folded: Folded) -> Request | None:
    """Ask for checks that are to follow another one, where that was run without them, or with others of their name."""
    for check in case_plan.checks:
        ended = folded.ended.get(check)
        left = tuple(one for one in wire.followers_of([check]) if one not in folded.followed)
        if left and has_passed(ended):
            limits = {check: _seconds(case_plan, folded, check)}
            return Request(case=case_plan.case, limits=limits, followers=left, leads=True)
    return None


def _comparison(case_plan: CasePlan, folded: Folded) -> Request | None:
    """Ask for the same loop in a second process."""
    loop = folded.ended.get(LOOP)
    if loop is None or loop.record.outcome is not Outcome.PASSED or LOOP not in case_plan.checks:
        return None
    # It can only make a finding, so a second process that hung or was killed is not tried again.
    if REPEAT in folded.ended or REPEAT in folded.overran | folded.shot:
        return None
    return Request(case=case_plan.case, limits={REPEAT: 2 * case_plan.seconds(LOOP)})

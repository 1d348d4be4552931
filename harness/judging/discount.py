"""Discount failures that the failing control of their adapter shares: they say nothing about the packages.

This is done check by check: a control whose picture fails says nothing about `single`. If its `single` fails, nothing
that needs `single` is believed.
"""

from __future__ import annotations

from collections.abc import Iterator

from harness.judging.runs import misleading
from harness.judging.runs.check import NEEDS, phase_of
from harness.model import FAILING, CheckRecord, ControlRecord, Outcome, Phase, PhaseRecord, replace
from harness.model.vocabulary import MISLEADING


def discount_phase(record: PhaseRecord, control: ControlRecord | None) -> PhaseRecord:
    """Return the record of a phase as it counts: `infra` if all its failures may be the adapter's, or the machine's."""
    if control is None or not control.failed:
        return record
    failing = [check for check in record.checks if check.outcome in FAILING]
    if record.outcome not in FAILING and not failing:
        return record
    if record.outcome in FAILING and not misleading.deciding_checks(failing):  # a finding that may not be there
        check = _suspect(record.phase.value, control)
        return (
            replace(record, outcome=Outcome.INFRA, decisive=_describe_discount(control, check, record.decisive))
            if check
            else record
        )
    checks = tuple(_discount_check(check, control) for check in record.checks)
    counting = misleading.deciding_checks(checks)
    worst = min((check.outcome for check in counting), key=list(Outcome).index, default=record.outcome)
    decisive = next((check.decisive for check in counting if check.outcome is worst), None)
    return replace(record, outcome=worst, decisive=decisive, checks=checks)


def _discount_check(record: CheckRecord, control: ControlRecord) -> CheckRecord:
    check = _suspect(record.check, control) if record.outcome in FAILING else None
    if check is None:
        return record
    return replace(record, outcome=Outcome.INFRA, decisive=_describe_discount(control, check, record.decisive))


def _describe_discount(control: ControlRecord, check: str, own: str | None) -> str:
    """Return the line of a discounted failure. The line of the control comes first: it is the one to look into."""
    return f"{control.control} fails, too, in {check}: {control.failed[check]}" + (f" (here: {own})" if own else "")


def _suspect(check: str, control: ControlRecord) -> str | None:
    """Return the control's failed check that discounts this one: itself, or one that stood in its way; else None."""
    if check in control.failed:
        return check
    # The control passed this very check, so the adapter is not in doubt here, whatever else of it failed.
    if check in control.passed:
        return None
    doubtful = set(_reached_over(phase_of(check)))
    # A misleading check that fails stops nobody, so it casts no doubt on the checks behind it.
    deciding = (failed for failed in control.failed if failed not in MISLEADING)
    return next((failed for failed in deciding if phase_of(failed) in doubtful), None)


def _reached_over(phase: Phase) -> Iterator[Phase]:
    """Yield the phase, then those that it needs."""
    needed: Phase | None = phase
    while needed:
        yield needed
        needed = NEEDS.get(needed)

"""Judge checks that compare a case with its own specification: their effect on the phase, and what they show.

Nothing is raised if such a check fails. The phase keeps the outcome of its other checks, and the case misleads.
"""

from __future__ import annotations

from collections.abc import Iterable

from harness.model import CheckRecord, Outcome
from harness.model.vocabulary import MISLEADING

SHOWING = frozenset({Outcome.FAILED, Outcome.FLAKY})
"""Outcomes of such a check by which the case misleads."""

COUNTING = frozenset({Outcome.CRASHED, Outcome.TIMED_OUT, Outcome.INFRA})
"""Outcomes of such a check that count in its phase: a dead process is loud, and after infra nothing is known."""


def deciding_checks(checks: Iterable[CheckRecord]) -> tuple[CheckRecord, ...]:
    """Return the checks that decide the outcome of a phase; it is the worst of theirs."""
    return tuple(check for check in checks if check.check not in MISLEADING or check.outcome in COUNTING)


def find(checks: Iterable[CheckRecord]) -> tuple[CheckRecord, ...]:
    """Return the checks by which a case contradicts its own specification."""
    return tuple(check for check in checks if check.check in MISLEADING and check.outcome in SHOWING)

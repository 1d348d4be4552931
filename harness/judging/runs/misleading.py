"""Checks that compare a case with its own specification: what one that fails does to its phase, and what it shows.

Nothing is raised where such a check fails, so that the phase keeps the outcome of its other checks: the case misleads.
"""

from __future__ import annotations

from collections.abc import Iterable

from harness.model import CheckRecord, Outcome
from harness.model.vocabulary import MISLEADING

SHOWING = frozenset({Outcome.FAILED, Outcome.FLAKY})
"""Outcomes of such a check by which the case misleads."""

COUNTING = frozenset({Outcome.CRASHED, Outcome.TIMED_OUT, Outcome.INFRA})
"""Outcomes of such a check that count in its phase: a dead process is loud, and after infra nothing is known."""


def settled(checks: Iterable[CheckRecord]) -> tuple[CheckRecord, ...]:
    """Return the checks of a phase that its outcome is the worst of."""
    return tuple(check for check in checks if check.check not in MISLEADING or check.outcome in COUNTING)


def shown(checks: Iterable[CheckRecord]) -> tuple[CheckRecord, ...]:
    """Return the checks by which a case contradicts its own specification."""
    return tuple(check for check in checks if check.check in MISLEADING and check.outcome in SHOWING)

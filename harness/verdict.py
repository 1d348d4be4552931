"""The order of outcomes: of several that count for one, the worst stands for all."""

from __future__ import annotations

from collections.abc import Iterable

from harness.model import Outcome

RANK = {outcome: place for place, outcome in enumerate(Outcome)}
"""The worst is 0."""


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """Return the first in the order of `Outcome`, which is worst first; `skipped` of nothing."""
    return min(outcomes, key=RANK.__getitem__, default=Outcome.SKIPPED)

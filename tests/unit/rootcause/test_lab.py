"""Tests what counts as progress of a repair."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from harness.judging.identity import Failure
from harness.model import Phase
from harness.rootcause.bench import Trial
from harness.rootcause.repair.lab import fails_further

PINNED = "Because dm-control==1.0.31 depends on mujoco>=3.3.3 and you require mujoco==3.3.2"
ON_37 = "Because mujoco==3.3.2 depends on Python>=3.8 and you require mujoco==3.3.2, we can conclude"
OTHER = "Because there is no version of torch==9 and you require torch==9"


def failing(phase: Phase, line: str, *causes: str) -> Trial:
    """Return a trial of which only the failure is looked at."""
    made: Any = SimpleNamespace(failure=Failure(phase=phase, causes=causes, line=line))
    return cast(Trial, made)


@pytest.mark.parametrize(
    ("before", "after", "progress"),
    [
        (failing(Phase.RESOLVE, PINNED), failing(Phase.RESOLVE, ON_37), False),
        (failing(Phase.RESOLVE, PINNED, "known"), failing(Phase.RESOLVE, ON_37), False),
        (failing(Phase.RESOLVE, PINNED), failing(Phase.RESOLVE, OTHER), True),
        (failing(Phase.RESOLVE, PINNED), failing(Phase.RESOLVE, "no solution found"), False),
        (failing(Phase.RESOLVE, PINNED), failing(Phase.SINGLE, "AttributeError"), True),
        (failing(Phase.SINGLE, "AttributeError"), failing(Phase.RESOLVE, PINNED), False),
        (failing(Phase.SINGLE, "AttributeError"), failing(Phase.SINGLE, "TypeError"), True),
        (failing(Phase.SINGLE, "x", "one"), failing(Phase.SINGLE, "y", "one"), False),
    ],
)
def test_progress(before: Trial, after: Trial, *, progress: bool) -> None:
    """Another sentence of the resolver about the same packages is none, nor is a failure of an earlier phase."""
    assert fails_further(before, after) is progress

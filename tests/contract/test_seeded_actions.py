"""Test that a case draws its actions from the space that was seeded.

HighwayEnv makes a new space in each reset: drawn from that, the actions, and so the trajectories, are others each time.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

Import = Callable[[str], Any]


class Space:
    """A space of so many choices, equal to others of that many."""

    def __init__(self, choices: int) -> None:
        self.choices = choices
        self.random = random.Random()

    def __eq__(self, other: object) -> bool:
        """Return whether the other space has as many choices."""
        return isinstance(other, Space) and other.choices == self.choices

    def __hash__(self) -> int:
        """Return the number of choices."""
        return self.choices

    def seed(self, seed: int) -> None:
        """Seed the choices."""
        self.random.seed(seed)

    def sample(self) -> int:
        """Return a choice."""
        return self.random.randrange(self.choices)


def actions(cell: Import, *, after: int) -> list[int]:
    """Seed the space of 1000 choices, put one of `after` choices in its place, and draw ten actions."""
    raw = SimpleNamespace(action_space=Space(1000))
    environment = cell("cell_gym_modern").ModernEnvironment(raw, None)
    environment.seed_actions(7)
    raw.action_space = Space(after)
    return [environment.action() for _ in range(10)]


def test_an_equal_space_in_its_place_changes_no_action(cell: Import) -> None:
    """Two episodes from one seed have the same actions."""
    assert actions(cell, after=1000) == actions(cell, after=1000)


def test_another_space_is_drawn_from_itself(cell: Import) -> None:
    """Actions have to be of the space that the environment has now."""
    assert max(actions(cell, after=3)) < 3

"""Make a bank of states for an environment whose whole state is its attribute `state`."""

import numpy as np

from .cell_bank import STATES, Maker

PLAYED = 0.6
"""The share of the states that random play came through; the others lie beyond it."""

BEYOND = 2.5
"""How far beyond the largest number that play came through the other states reach."""


class AttributeMaker(Maker):
    """Makes states by play, and others spread over and beyond the numbers that play came through, of either sign."""

    def __init__(self, env, physics, seed, states=STATES):
        super().__init__(env, physics, seed, states)
        self.counts = [round(PLAYED * states), 0, 0, states - round(PLAYED * states)]

    def _changed(self, kind, count, played):
        largest = np.max(np.abs([row["state.state"] for row in played]), axis=0)
        return [self._spread(kind, largest) for _ in range(count)]

    def _spread(self, kind, largest):
        shares = np.array([2.0 * self.dice.random() - 1.0 for _ in largest])
        self.physics.write({"state": BEYOND * largest * shares})
        return self._row(kind)

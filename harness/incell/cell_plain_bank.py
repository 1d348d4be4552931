"""Make a bank of states where no simulator can be asked for one: of an attribute `state`, or of seeds and actions."""

import numpy as np

from .cell_bank import STATES, Maker
from .cell_physics import HORIZON, SEEDS

PLAYED = 0.6
"""The share of the states that random play came through; the others lie beyond it."""

BEYOND = 2.5
"""The reach of the other states, as a multiple of the largest number that play came through."""


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


class SeededMaker(Maker):
    """Makes runs from seeds, each with the actions before it."""

    def make(self):
        """Return the bank: arrays by name, one row a seed and a number of actions since."""
        rows = []
        for seed in range(SEEDS):
            past = np.zeros((HORIZON - 1, self.space.size))
            for count in range(HORIZON):
                self.physics.present = {
                    "seed": np.array([float(seed)]),
                    "count": np.array([float(count)]),
                    "past": past.ravel().copy(),
                }
                rows.append(self._row(0))
                if count < HORIZON - 1:
                    past[count] = rows[-1]["action"]
        return {name: np.array([row[name] for row in rows]) for name in sorted(rows[0])}

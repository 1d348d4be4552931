"""Make a bank of states of MJX and Brax: of play, of falls, of overlaps, of joints at their limits."""

import numpy as np

from .cell_bank import Maker

FASTEST_SPEED = 200.0
"""The speed after one step beyond which a state is not used: overlaps throw bodies apart."""

TURN = {"free": 3, "ball": 0}
"""The place of the quaternion behind the first number of such a joint."""


class FunctionalMaker(Maker):
    """Makes the states of one environment."""

    def _usable(self):
        physics, state = self.physics, self.physics.read()
        physics.step(self.space.as_action(np.zeros(self.space.size)))
        after = physics.read()
        physics.write(state)
        numbers = np.concatenate(list(after.values()))
        return bool(np.all(np.isfinite(numbers)) and np.max(np.abs(after[physics.velocities])) < FASTEST_SPEED)

    def _overlaps(self):
        return True

    def _any(self, count):
        """Return numbers between -0.5 and 0.5."""
        return np.array([self.dice.random() - 0.5 for _ in range(count)])

    def _stir(self, size, lift):
        """Move joints, bodies and velocities by random amounts, and lift bodies by up to `lift`."""
        physics, state = self.physics, self.physics.read()
        places, speeds = state[physics.positions], state[physics.velocities]
        for place, kind, limits in physics.joints():
            if kind is None:
                span = min(limits[1] - limits[0], 3.0) if limits else 1.0
                places[place] += size * span * (self.dice.random() - 0.5)
                continue
            if kind == "free":
                places[place + 2] += lift * self.dice.random()
            turn = slice(place + TURN[kind], place + TURN[kind] + 4)
            turned = places[turn] + size * self._any(4)
            places[turn] = turned / np.sqrt(np.sum(turned * turned))
        speeds += size * 4.0 * self._any(speeds.size)
        physics.write(state)

    def _drop(self):
        """Lift what can be lifted, turn it, and let it fall for some steps."""
        self._stir(0.6, 0.6)
        for _ in range(self.dice.randrange(1, 12)):
            self.physics.step(self.space.as_action(self.space.draw(self.dice)))

    def _overlap(self):
        """Push bodies into each other, or into the ground."""
        self._stir(0.9, -0.3)

    def _limit(self):
        """Put joints at and beyond their limits."""
        physics, state = self.physics, self.physics.read()
        for place, _, limits in physics.joints():
            if limits and self.dice.random() < 0.6:
                beyond = (limits[1] - limits[0]) * (0.06 * self.dice.random() - 0.02)
                state[physics.positions][place] = self.dice.choice((limits[0] - beyond, limits[1] + beyond))
        physics.write(state)

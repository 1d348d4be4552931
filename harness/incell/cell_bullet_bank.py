"""Make a bank of states of a PyBullet environment: of play, of falls, of overlaps, of joints at their limits."""

import numpy as np

from .cell_bank import Maker

FASTEST_SPEED = 200.0
"""The speed after one step of the simulator beyond which a state is not used: overlaps throw bodies apart."""

DEEP = -1e-3


class BulletMaker(Maker):
    """Makes the states of one environment."""

    def _usable(self):
        physics, state = self.physics, self.physics.read()
        physics.write(state)
        physics.simulate()
        after = physics.read()
        physics.write(state)
        speeds = np.concatenate([values for name, values in after.items() if name.endswith("velocity")])
        numbers = np.concatenate(list(after.values()))
        return bool(np.all(np.isfinite(numbers)) and np.max(np.abs(speeds)) < FASTEST_SPEED)

    def _overlaps(self):
        return any(one[4] < DEEP for one in self.physics.touching())

    def _limits(self):
        """Return the lower and upper limit of each joint, or None where it has none, in the order of the state."""
        client = self.physics.client
        limits = [tuple(client.getJointInfo(*pair)[8:10]) for pair in self.physics.pairs]
        return [pair if pair[0] < pair[1] else None for pair in limits]

    def _any(self, count):
        """Return numbers between -0.5 and 0.5."""
        return np.array([self.dice.random() - 0.5 for _ in range(count)])

    def _stir(self, size, lift):
        """Move joints, bodies and velocities by random amounts, and lift bodies by up to `lift`."""
        state = self.physics.read()
        if "joint" in state:
            spans = np.array([min(limits[1] - limits[0], 3.0) if limits else 1.0 for limits in self._limits()])
            state["joint"] += size * spans * self._any(spans.size)
            state["joint_velocity"] += size * 4.0 * self._any(spans.size)
        if "base" in state:
            for pose in state["base"].reshape(-1, 7):
                pose[2] += lift * self.dice.random()
                turned = pose[3:] + size * self._any(4)
                pose[3:] = turned / np.sqrt(np.sum(turned * turned))
            state["base_velocity"] += size * 4.0 * self._any(state["base_velocity"].size)
        self.physics.write(state)

    def _drop(self):
        """Lift what can be lifted, turn it, and let it fall for some steps."""
        self._stir(0.6, 0.6)
        for _ in range(self.dice.randrange(1, 60)):
            self.physics.simulate()

    def _overlap(self):
        """Push bodies into each other, or into the ground."""
        self._stir(0.9, -0.3)

    def _limit(self):
        """Put joints at and beyond their limits."""
        state = self.physics.read()
        for number, limits in enumerate(self._limits()):
            if limits and self.dice.random() < 0.6:
                beyond = (limits[1] - limits[0]) * (0.06 * self.dice.random() - 0.02)
                state["joint"][number] = self.dice.choice((limits[0] - beyond, limits[1] + beyond))
        self.physics.write(state)

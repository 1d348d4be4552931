"""Make a bank of states: those that play comes through, falls, overlaps, joints at their limits, and grasps.

Every number comes from Python's own generator, which gives the same ones on every version, and states are rounded to
float32, so that a bank is half as large and every release can represent it.
"""

import random

import numpy as np

from .cell_action_space import action_space_of
from .cell_gripper import gripper_of

STATES = 300
KINDS = ("play", "drop", "overlap", "limit", "grasp")
SHARES, SHARES_WITH_GRASPS = (0.4, 0.2, 0.2, 0.2, 0.0), (0.35, 0.15, 0.15, 0.15, 0.2)
EPISODE = 60
FASTEST = 1e5
"""The acceleration, in the units of the model, beyond which a state is not used."""


def rounded(values):
    """Return values as float32 holds them, as float64."""
    return np.asarray(values, dtype=np.float32).astype(float)


class Maker:
    """Makes the states of one environment."""

    def __init__(self, env, physics, seed, states=STATES):
        self.env = env
        self.physics = physics
        self.space = action_space_of(env)
        self.dice = random.Random(seed)
        self.seed = seed
        self.gripper = gripper_of(physics)
        self.reach = 1.0
        self.counts = [round(share * states) for share in (SHARES_WITH_GRASPS if self.gripper else SHARES)]

    def make(self):
        """Return the bank: arrays by name, one row a state."""
        rows = []
        while len(rows) < self.counts[0]:
            rows.extend(self._play(self.counts[0] - len(rows)))
        played = list(rows)
        for kind, count in list(enumerate(self.counts))[1:]:
            rows.extend(self._changed(kind, count, played))
        rows.extend(self._changed(1, sum(self.counts) - len(rows), played))  # in place of grasps that no try made
        names = sorted({name for row in rows for name in row})
        return {name: np.array([row[name] for row in rows]) for name in names}

    def _play(self, most):
        """Play one episode with random actions, each held for some steps, and return some of its states."""
        self.seed += 1
        self.env.reset(self.seed)
        rows, action = [], self.space.draw(self.dice)
        for _ in range(EPISODE):
            if self.dice.random() < 0.3:
                action = self.space.draw(self.dice)
            if self.dice.random() < 0.2 and len(rows) < most:
                rows.append(self._row(0))
            if any(self.env.step(self.space.as_action(action))[2:4]):
                break
        return rows

    def _row(self, kind):
        """Return the present state as one row, with an action to take from it."""
        physics = self.physics
        row = {"state." + name: rounded(values) for name, values in physics.read().items()}
        if physics.warm_starts:
            row["warm"] = rounded(physics.warm_start())
        return dict(row, action=self.space.draw(self.dice), kind=np.array(kind))

    def _changed(self, kind, count, played):
        """Return states that are made of played ones: the better half of what was tried, by what the kind is about."""
        rows, tries = [], 0
        while len(rows) < count and tries < 60 * count:
            tries += 1
            self.reach = 1.0 if tries <= 20 * count else 0.1
            row = self.dice.choice(played)
            self.physics.write({name[6:]: values for name, values in row.items() if name.startswith("state.")})
            getattr(self, "_" + KINDS[kind])()
            if self._usable() and self._is_of_kind(kind, tries > 30 * count):
                rows.append(self._row(kind))
        return rows

    def _is_of_kind(self, kind, late):
        """Return whether the present state has what its kind is about; overlaps may be rare."""
        if KINDS[kind] == "overlap":
            return late or self._overlaps()
        return KINDS[kind] != "grasp" or self.gripper.holds(self.physics)

    def _usable(self):
        data = self.physics.data
        self.physics.mujoco.mj_forward(self.physics.model, data)
        numbers = np.concatenate([data.qpos, data.qvel, data.qacc])
        return bool(np.all(np.isfinite(numbers)) and np.max(np.abs(data.qacc)) < FASTEST)

    def _overlaps(self):
        data = self.physics.data
        return any(data.contact[number].dist < -1e-3 for number in range(data.ncon))

    def _joints(self):
        """Yield (first number in qpos, is it a free joint, its limits or None) of each joint."""
        model = self.physics.model
        for joint in range(model.njnt):
            limited = bool(model.jnt_limited[joint])
            limits = tuple(model.jnt_range[joint]) if limited and model.jnt_type[joint] in (2, 3) else None
            yield int(model.jnt_qposadr[joint]), int(model.jnt_type[joint]), limits

    def _stir(self, size):
        """Move joints and velocities by random amounts; joints alone, by less, once many tries made no state."""
        data, dice, size = self.physics.data, self.dice, self.reach * size
        for place, kind, limits in self._joints():
            if kind in (2, 3):
                span = (limits[1] - limits[0]) if limits else 1.0
                data.qpos[place] += size * span * (dice.random() - 0.5)
            else:
                start = place + (3 if kind == 0 else 0)
                turned = data.qpos[start : start + 4] + size * np.array([dice.random() - 0.5 for _ in range(4)])
                data.qpos[start : start + 4] = turned / np.sqrt(np.sum(turned * turned))
        if self.reach == 1.0:
            data.qvel[:] += size * 4.0 * np.array([dice.random() - 0.5 for _ in range(self.physics.model.nv)])
        self._follow()

    def _follow(self):
        """Put each mocap body where the body is that is welded to it, so that it does not tear at it."""
        physics = self.physics
        model, data, mujoco = physics.model, physics.data, physics.mujoco
        mujoco.mj_kinematics(model, data)
        for weld in range(model.neq):
            if int(model.eq_type[weld]) == int(mujoco.mjtEq.mjEQ_WELD):
                ends = int(model.eq_obj1id[weld]), int(model.eq_obj2id[weld])
                for mocap, body in (ends, ends[::-1]):
                    if model.body_mocapid[mocap] >= 0:
                        data.mocap_pos[model.body_mocapid[mocap]] = data.xpos[body]
                        data.mocap_quat[model.body_mocapid[mocap]] = data.xquat[body]

    def _controls(self, extreme=False):
        model, dice = self.physics.model, self.dice
        for number in range(model.nu):
            low, high = model.actuator_ctrlrange[number] if model.actuator_ctrllimited[number] else (-1.0, 1.0)
            share = dice.randrange(2) if extreme else dice.random()
            self.physics.data.ctrl[number] = low + (high - low) * share

    def _drop(self):
        """Lift what can be lifted, turn it, and let it fall for some steps."""
        self._stir(0.6)
        for place, kind, _ in self._joints():
            if kind == 0:
                self.physics.data.qpos[place + 2] += 0.6 * self.dice.random()
        self._controls()
        for _ in range(self.dice.randrange(1, 60)):
            self.physics.simulate()

    def _overlap(self):
        """Push bodies into each other, or into the ground."""
        self._stir(0.9)
        for place, kind, _ in self._joints():
            if kind == 0:
                self.physics.data.qpos[place + 2] -= 0.3 * self.dice.random()
        self._controls()

    def _limit(self):
        """Put joints at and beyond their limits, and controls at their ends."""
        for place, _, limits in self._joints():
            if limits and self.dice.random() < 0.6:
                beyond = (limits[1] - limits[0]) * (0.06 * self.dice.random() - 0.02)
                self.physics.data.qpos[place] = self.dice.choice((limits[0] - beyond, limits[1] + beyond))
        self._follow()
        self._controls(extreme=True)

    def _grasp(self):
        """Put a free body between the open fingers, and close them on it for some steps."""
        self.gripper.close(self.physics, self.dice)

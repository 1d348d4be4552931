"""Contacts: whether a robot pushes what it meets, or passes through it."""

import numpy as np

from .cell_errors import skip
from .cell_misleading import contradiction, misleading
from .cell_mujoco import bindings, simulation

POSES = 1000
"""Poses of the robot that are tried, in search of those in which it touches an object."""

TRIALS, ENOUGH = 5, 3
"""The largest number of trials, and how many of those in which nothing is pushed decide."""

DEPTHS = (0.003, 0.02)
"""Depths (m) by which the robot and the object overlap at the start of a trial."""

SECONDS = 1.0
MOST_STEPS = 1000
FREE, BALL, SLIDE, HINGE = range(4)
"""mjtJoint"""

JOINTS = (0, 1)
"""mjtTrn: what an actuator that moves a joint is"""


@misleading
def contact(probe, facts):
    """Put an object into the robot, a little, and see whether it is pushed out.

    An object is a body that only slides, or floats, and that no actuator moves. By MuJoCo's documentation the
    constraint solver pushes apart whatever overlaps in a contact, if slowly.
    """
    mujoco, model = bindings(), simulation(probe).model
    scene = Scene(mujoco, model)
    objects = scene.objects()
    if not objects:
        skip("contact.nothing")
    tried = 0
    for body in objects:
        trials = scene.trials(body)
        tried += len(trials)
        facts.setdefault("overlaps", []).extend([round(before, 5), round(after, 5)] for before, after, _ in trials)
        if len(trials) >= ENOUGH and not any(_pushed(*trial) for trial in trials):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
            before, after, _ = trials[0]
            before, after = 1000 * float(before), 1000 * float(after)
            return contradiction("contact.through", name=repr(name), before=before, after=after)
    if not tried:
        skip("unmeasured.contact", poses=POSES)
    return None


def _pushed(before, after, moved):
    """Tell whether the overlap became less, or the object has moved."""
    return after < 0.95 * before or moved > 0.05 * before


class Scene:
    """A model with data of its own, in which bodies are put somewhere."""

    def __init__(self, mujoco, model):
        self.mujoco = mujoco
        self.model = model
        self.data = mujoco.MjData(model)
        self.random = np.random.RandomState(0)
        self.robot = self._robot()
        self.limbs = [
            joint
            for joint in range(model.njnt)
            if int(model.jnt_bodyid[joint]) in self.robot and model.jnt_type[joint] in (SLIDE, HINGE)
        ]

    def objects(self):
        """Return the bodies that can be pushed by what an actuator moves."""
        return [body for body in range(1, self.model.nbody) if self._pushable(body) and self._pairs(body)]

    def trials(self, body):
        """Return (overlap, overlap a second later, way of the object) of some trials, in m."""
        found = []
        for _ in range(POSES):
            if len(found) == TRIALS:
                break
            if self._touching(body):
                found.append(self._trial(body))
        return found

    def _robot(self):
        """Return the bodies that an actuator moves, and what hangs on them."""
        model, found = self.model, set()
        actuators = [number for number in range(model.nu) if model.actuator_trntype[number] in JOINTS]
        own = {int(model.jnt_bodyid[model.actuator_trnid[number, 0]]) for number in actuators}
        for body in range(1, model.nbody):  # a parent has a smaller number
            if body in own or int(model.body_parentid[body]) in found:
                found.add(body)
        return found

    def _joints(self, body):
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def _pushable(self, body):
        """Tell whether a body stands by itself, slides or floats, and is tied to nothing."""
        model = self.model
        if body in self.robot or int(model.body_parentid[body]) != 0:
            return False
        tied = {*model.eq_obj1id.tolist(), *model.eq_obj2id.tolist()}
        kinds = [int(model.jnt_type[joint]) for joint in self._joints(body)]
        return body not in tied and bool(kinds) and (kinds == [FREE] or set(kinds) == {SLIDE})

    def _geoms(self, bodies):
        return [geom for geom in range(self.model.ngeom) if int(self.model.geom_bodyid[geom]) in bodies]

    def _pairs(self, body):
        """Return the pairs of geoms, of the object and of the robot, that may touch."""
        robot = self._geoms(self.robot)
        return [(one, two) for one in self._geoms({body}) for two in robot if self._collide(one, two)]

    def _collide(self, one, two):
        types, affinities = self.model.geom_contype, self.model.geom_conaffinity
        return bool(types[one] & affinities[two] or types[two] & affinities[one])

    def _touching(self, body):
        """Pose the robot at random and lay the object against it; whether they touch, and nothing else does."""
        model, data = self.model, self.data
        self.mujoco.mj_resetData(model, data)
        for joint in self.limbs:
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1, 1)
            data.qpos[model.jnt_qposadr[joint]] = self.random.uniform(low, high)
        self.mujoco.mj_kinematics(model, data)
        pairs = self._pairs(body)
        one, two = pairs[self.random.randint(len(pairs))]
        aside = self.random.standard_normal(3)
        aside *= self.random.uniform(0, 0.9) * (model.geom_rbound[one] + model.geom_rbound[two]) / np.linalg.norm(aside)
        self._shift(body, data.geom_xpos[two] - data.geom_xpos[one] + aside)
        self.mujoco.mj_fwdPosition(model, data)
        others = [item for item in self._contacts() if item.dist < -DEPTHS[0] and not self._between(item, body)]
        return DEPTHS[0] < self._overlap(body) < DEPTHS[1] and not others

    def _shift(self, body, way):
        for joint in self._joints(body):
            place = int(self.model.jnt_qposadr[joint])
            if self.model.jnt_type[joint] == FREE:
                self.data.qpos[place : place + 3] += way
            else:
                self.data.qpos[place] += self.data.xaxis[joint] @ way

    def _contacts(self):
        return [self.data.contact[number] for number in range(self.data.ncon)]

    def _between(self, item, body):
        """Tell whether a contact is one of the object and the robot."""
        bodies = {int(self.model.geom_bodyid[item.geom1]), int(self.model.geom_bodyid[item.geom2])}
        return body in bodies and bodies - {body} <= self.robot

    def _overlap(self, body):
        return max([-float(item.dist) for item in self._contacts() if self._between(item, body)] + [0.0])

    def _trial(self, body):
        before, start = self._overlap(body), np.array(self.data.xpos[body])
        for _ in range(min(MOST_STEPS, int(np.ceil(SECONDS / self.model.opt.timestep)))):
            self.mujoco.mj_step(self.model, self.data)
        return before, self._overlap(body), float(np.linalg.norm(self.data.xpos[body] - start))

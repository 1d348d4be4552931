"""Check that a robot pushes the objects that it touches and does not pass through them."""

import numpy as np

from .cell_errors import skip
from .cell_mujoco import bindings, simulation
from .cell_specification import compares_with_specification, contradiction

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


@compares_with_specification
def run(probe, facts):
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
    """Return whether the overlap became less, or the object has moved."""
    return after < 0.95 * before or moved > 0.05 * before


class Scene:
    """A model with data of its own, in which bodies are moved."""

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
        return [body for body in range(1, self.model.nbody) if self._is_pushable(body) and self._pairs(body)]

    def trials(self, body):
        """Return (overlap, overlap a second later, distance that the object moved) of some trials, in m."""
        trials = []
        for _ in range(POSES):
            if len(trials) == TRIALS:
                break
            if self._place_touching(body):
                trials.append(self._trial(body))
        return trials

    def _robot(self):
        """Return the bodies that an actuator moves, and all bodies below them."""
        model, robot = self.model, set()
        actuators = [number for number in range(model.nu) if model.actuator_trntype[number] in JOINTS]
        moved = {int(model.jnt_bodyid[model.actuator_trnid[number, 0]]) for number in actuators}
        for body in range(1, model.nbody):  # a parent has a smaller number
            if body in moved or int(model.body_parentid[body]) in robot:
                robot.add(body)
        return robot

    def _joints(self, body):
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def _is_pushable(self, body):
        """Return whether a body stands by itself, slides or floats, and is tied to nothing."""
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
        return [
            (first, second) for first in self._geoms({body}) for second in robot if self._can_collide(first, second)
        ]

    def _can_collide(self, first, second):
        types, affinities = self.model.geom_contype, self.model.geom_conaffinity
        return bool(types[first] & affinities[second] or types[second] & affinities[first])

    def _place_touching(self, body):
        """Pose the robot at random, lay the object against it and return whether they touch, and nothing else does."""
        model, data = self.model, self.data
        self.mujoco.mj_resetData(model, data)
        for joint in self.limbs:
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1, 1)
            data.qpos[model.jnt_qposadr[joint]] = self.random.uniform(low, high)
        self.mujoco.mj_kinematics(model, data)
        pairs = self._pairs(body)
        first, second = pairs[self.random.randint(len(pairs))]
        offset = self.random.standard_normal(3)
        offset *= (
            self.random.uniform(0, 0.9)
            * (model.geom_rbound[first] + model.geom_rbound[second])
            / np.linalg.norm(offset)
        )
        self._shift(body, data.geom_xpos[second] - data.geom_xpos[first] + offset)
        self.mujoco.mj_fwdPosition(model, data)
        others = [item for item in self._contacts() if item.dist < -DEPTHS[0] and not self._is_between(item, body)]
        return DEPTHS[0] < self._overlap(body) < DEPTHS[1] and not others

    def _shift(self, body, shift):
        for joint in self._joints(body):
            place = int(self.model.jnt_qposadr[joint])
            if self.model.jnt_type[joint] == FREE:
                self.data.qpos[place : place + 3] += shift
            else:
                self.data.qpos[place] += self.data.xaxis[joint] @ shift

    def _contacts(self):
        return [self.data.contact[number] for number in range(self.data.ncon)]

    def _is_between(self, item, body):
        """Return whether a contact is one of the object and the robot."""
        bodies = {int(self.model.geom_bodyid[item.geom1]), int(self.model.geom_bodyid[item.geom2])}
        return body in bodies and bodies - {body} <= self.robot

    def _overlap(self, body):
        return max([-float(item.dist) for item in self._contacts() if self._is_between(item, body)] + [0.0])

    def _trial(self, body):
        before, start = self._overlap(body), np.array(self.data.xpos[body])
        for _ in range(min(MOST_STEPS, int(np.ceil(SECONDS / self.model.opt.timestep)))):
            self.mujoco.mj_step(self.model, self.data)
        return before, self._overlap(body), float(np.linalg.norm(self.data.xpos[body] - start))

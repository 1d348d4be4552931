"""Read and set the state of a PyBullet simulation, and advance it by an environment that was written for it."""

import math

import numpy as np

from .cell_errors import library

MOVABLE = (0, 1)
"""The kinds of joints whose state is one number: those that turn, and those that slide."""

APART = 1000.0
"""The distance between lifted bodies, in m: nothing touches."""


def bullet_of(raw):
    """Return the PyBullet client of an environment; None if it has none."""
    client = getattr(raw, "_p", None)
    return client if hasattr(client, "resetJointState") else None


class BulletPhysics:
    """Bodies and joints of a PyBullet client, and the environment's own step.

    A state does not hold what PyBullet does not let one set. So that it is the same each time, bodies are lifted apart
    before a state is set: what contacts were in the steps before is then forgotten.
    """

    method = "state"
    unset = ("contact caches", "targets of motors", "what the environment keeps but for its potential")
    warm_starts = False
    pure = False
    stages = None
    precision = np.dtype(float)

    def __init__(self, raw, client):
        self.raw = raw
        self.client = client
        self.bodies = [client.getBodyUniqueId(number) for number in range(client.getNumBodies())]
        self.free = [body for body in self.bodies if client.getDynamicsInfo(body, -1)[0] > 0]
        self.stands = {body: client.getBasePositionAndOrientation(body) for body in self.bodies}
        self.pairs = [(body, joint) for body in self.bodies for joint in self._movable(body)]
        self.parts = ("base", "base_velocity") * bool(self.free) + ("joint", "joint_velocity") * bool(self.pairs)

    def _movable(self, body):
        numbers = range(self.client.getNumJoints(body))
        return [number for number in numbers if self.client.getJointInfo(body, number)[2] in MOVABLE]

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        client = self.client
        poses = [np.concatenate(client.getBasePositionAndOrientation(body)) for body in self.free]
        speeds = [np.concatenate(client.getBaseVelocity(body)) for body in self.free]
        joints = [client.getJointState(*pair)[:2] for pair in self.pairs]
        values = (poses, speeds, [pair[0] for pair in joints], [pair[1] for pair in joints])
        present = dict(zip(("base", "base_velocity", "joint", "joint_velocity"), values))
        return {name: np.array(present[name], dtype=float).ravel() for name in self.parts}

    def write(self, state, _warm=None):
        """Part all bodies, set the state, and let the environment look at it as at one that it begins with."""
        client = self.client
        self._part()
        for number, body in enumerate(self.free):
            pose, speed = state["base"][7 * number :][:7].tolist(), state["base_velocity"][6 * number :][:6].tolist()
            length = math.sqrt(sum(part * part for part in pose[3:]))
            client.resetBasePositionAndOrientation(body, pose[:3], [part / length for part in pose[3:]])
            client.resetBaseVelocity(body, speed[:3], speed[3:])
        for number, pair in enumerate(self.pairs):
            client.resetJointState(*pair, float(state["joint"][number]), float(state["joint_velocity"][number]))
        self._look()

    def _part(self):
        """Lift bodies apart with all joints at 0, step, so that nothing touches, and put them back."""
        client = self.client
        for number, body in enumerate(self.bodies):
            client.resetBasePositionAndOrientation(body, (0, 0, APART * (number + 1)), (0, 0, 0, 1))
        for pair in self.pairs:
            client.resetJointState(*pair, 0.0, 0.0)
        client.stepSimulation()  # early releases cannot detect contacts without a step
        for body, pose in self.stands.items():
            client.resetBasePositionAndOrientation(body, *pose)

    def _look(self):
        """Let the environment's robot read the state, and set what rewards are differences to."""
        robot = getattr(self.raw, "robot", None)
        if hasattr(robot, "calc_state"):
            if hasattr(robot, "feet_contact"):
                robot.feet_contact[:] = 0
            with library:
                robot.calc_state()
                self.raw.potential = robot.calc_potential()

    def step(self, action):
        """Make one step of the environment."""
        return self.raw.step(action)

    def simulate(self):
        """Make one step of the simulator."""
        with library:
            self.client.stepSimulation()

    def outcome(self):
        """Return the state after a step."""
        return np.concatenate(list(self.read().values()))

    def touching(self):
        """Return (body, link, other body, its link, distance) of each contact; none where only a step would tell."""
        detect = getattr(self.client, "performCollisionDetection", None)
        if detect is None:
            return []
        detect()
        points = self.client.getContactPoints() or ()
        return [tuple(point[place] for place in (1, 3, 2, 4, 8)) for point in points]

    def contacts(self):
        """Return the pairs of links in contact, sorted."""
        return tuple(sorted({("{}.{}".format(*one[:2]), "{}.{}".format(*one[2:4])) for one in self.touching()}))

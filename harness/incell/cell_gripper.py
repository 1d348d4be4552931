"""Find a gripper of two fingers in a model of MuJoCo, and close it on a free body."""

import numpy as np

FREE, SLIDE = 0, 2
"""Numbers of types of joints."""

CLOSING = (5, 50)
"""Steps of the simulator that fingers close for."""

TURNED = 0.5
"""The share of grasps whose body is turned at random."""


def gripper_of(physics):
    """Return the gripper of a model that also has a free body, or None.

    Fingers are bodies on one body, each of which slides within limits on a joint that an actuator moves.
    """
    model = getattr(physics, "model", None)
    if model is None:
        return None
    kinds = np.array(model.jnt_type)
    free = [joint for joint in range(model.njnt) if kinds[joint] == FREE]
    actuators = {
        int(model.actuator_trnid[number, 0]): number for number in range(model.nu) if not model.actuator_trntype[number]
    }
    fingers = {}
    for joint, actuator in sorted(actuators.items()):
        if kinds[joint] == SLIDE and model.jnt_limited[joint]:
            fingers.setdefault(int(model.body_parentid[model.jnt_bodyid[joint]]), []).append((joint, actuator))
    pairs = [pair for pair in fingers.values() if len(pair) == 2]
    return Gripper(model, pairs[0], free) if pairs and free else None


class Gripper:
    """Two fingers, each a joint and an actuator, and the joints of free bodies."""

    def __init__(self, model, fingers, free):
        self.fingers = fingers
        self.free = free
        self.held = None
        self.geometries = [_solid(model, int(model.jnt_bodyid[joint])) for joint, _ in fingers]

    def close(self, physics, dice):
        """Put a free body between the open fingers, at rest, and close them on it for some steps."""
        model, data, mujoco = physics.model, physics.data, physics.mujoco
        pair = [dice.choice(found) for found in self.geometries]
        ends = [self._ends(physics, number, pair) for number in range(2)]
        for (joint, _), (_, opened) in zip(self.fingers, ends):
            data.qpos[model.jnt_qposadr[joint]] = opened
            data.qvel[model.jnt_dofadr[joint]] = 0
        mujoco.mj_kinematics(model, data)
        self.held = dice.choice(self.free)
        place, rate = int(model.jnt_qposadr[self.held]), int(model.jnt_dofadr[self.held])
        middle = np.mean(data.geom_xpos[pair], axis=0)
        data.qpos[place : place + 3] = middle + 0.01 * np.array([dice.random() - 0.5 for _ in range(3)])
        if dice.random() < TURNED:
            turned = np.array([dice.random() - 0.5 for _ in range(4)])
            data.qpos[place + 3 : place + 7] = turned / np.sqrt(np.sum(turned * turned))
        data.qvel[rate : rate + 6] = 0
        for (_, actuator), (closed, opened) in zip(self.fingers, ends):
            pushes = np.sign(model.actuator_gainprm[actuator, 0] * model.actuator_gear[actuator, 0]) or 1.0
            low, high = model.actuator_ctrlrange[actuator]
            data.ctrl[actuator] = high if (closed > opened) == (pushes > 0) else low
        for _ in range(dice.randrange(*CLOSING)):
            physics.simulate()

    def _ends(self, physics, number, pair):
        """Return the closed and the open end of a finger's joint: with the first the fingers are closer."""
        model, data = physics.model, physics.data
        joint = self.fingers[number][0]
        place, limits, distances = int(model.jnt_qposadr[joint]), model.jnt_range[joint], []
        before = float(data.qpos[place])
        for end in limits:
            data.qpos[place] = end
            physics.mujoco.mj_kinematics(model, data)
            distances.append(float(np.sum((data.geom_xpos[pair[0]] - data.geom_xpos[pair[1]]) ** 2)))
        data.qpos[place] = before
        return tuple(limits) if distances[0] < distances[1] else tuple(limits[::-1])

    def holds(self, physics):
        """Return whether both fingers touch the body that was put between them."""
        model, data = physics.model, physics.data
        body = set(_solid(model, int(model.jnt_bodyid[self.held])))
        met = [{int(data.contact[n].geom1), int(data.contact[n].geom2)} for n in range(data.ncon)]
        return all(any(pair & body and pair & set(finger) for pair in met) for finger in self.geometries)


def _solid(model, body):
    """Return the geometries of a body, and of the bodies on it, that can touch others."""
    inside = {body}
    for child in range(body + 1, model.nbody):
        if int(model.body_parentid[child]) in inside:
            inside.add(child)
    return [
        number
        for number in range(model.ngeom)
        if int(model.geom_bodyid[number]) in inside and (model.geom_contype[number] or model.geom_conaffinity[number])
    ]

"""Check that an environment begins in the pose that it documents."""

from .cell_errors import skip
from .cell_mujoco import bindings, simulation
from .cell_specification import compares_with_specification, contradiction

FAR = 0.05
"""The largest distance (m, or rad) of a joint from its documented start."""


@compares_with_specification
def run(probe, facts):
    """Compare the joints after a reset with the environment's own `initial_qpos` (m or rad).

    The source is what gymnasium-robotics documents of that argument of its robots: "initial position value of the
    joints in the MuJoCo simulation". Joints that begin elsewhere with another seed, such as those of an object that
    is laid somewhere, are left out.
    """
    mujoco, simulated = bindings(), simulation(probe)
    if simulated.starts is None:
        skip("start.undocumented")
    if simulated.settles:
        skip("start.settles")
    model, starts = simulated.model, simulated.starts
    addresses = [*model.jnt_qposadr.tolist(), int(model.nq)]
    places = {joint: list(range(*addresses[joint : joint + 2])) for joint in range(model.njnt)}
    spreads = {joint: [abs(start[at] - starts[0][at]).max() for start in starts[1:]] for joint, at in places.items()}
    joints = [joint for joint in places if all(spread < FAR / 10 for spread in spreads[joint])]
    if not joints:
        skip("start.random")
    gaps = abs(starts[0] - simulated.initial_qpos)
    away = [joint for joint in joints if gaps[places[joint]].max() > FAR]
    facts["joints"] = len(joints)
    if not away:
        return None
    farthest = max(away, key=lambda joint: gaps[places[joint]].max())
    name = repr(mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, farthest))
    place = max(places[farthest], key=lambda place: gaps[place])
    got, promised = float(starts[0][place]), float(simulated.initial_qpos[place])
    return contradiction("start.elsewhere", away=len(away), joints=len(joints), name=name, got=got, promised=promised)

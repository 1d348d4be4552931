"""The start pose: whether an environment begins where it says that it does."""

from .cell_errors import skip
from .cell_misleading import contradiction, misleading
from .cell_mujoco import bindings, simulation

FAR = 0.05
"""The largest distance (m, or rad) of a joint from its documented start."""


@misleading
def start_pose(probe, facts):
    """Compare the joints after a reset with the environment's own `initial_qpos`.

    The source is what gymnasium-robotics documents of that argument of its robots: "initial position value of the
    joints in the MuJoCo simulation". Joints that begin elsewhere with another seed, such as those of an object that
    is laid somewhere, are left out.
    """
    mujoco, found = bindings(), simulation(probe)
    if found.starts is None:
        skip("start.undocumented")
    if found.settles:
        skip("start.settles")
    joints = [joint for joint in range(found.model.njnt) if _fixed(found, joint)]
    if not joints:
        skip("start.random")
    away = [joint for joint in joints if _gap(found, joint) > FAR]
    facts["joints"] = len(joints)
    if not away:
        return None
    farthest = max(away, key=lambda joint: _gap(found, joint))
    name = mujoco.mj_id2name(found.model, mujoco.mjtObj.mjOBJ_JOINT, farthest)
    place = _farthest(found, farthest)
    got, promised = float(found.starts[0][place]), float(found.held[place])
    return contradiction(
        "start.elsewhere", away=len(away), joints=len(joints), name=repr(name), got=got, promised=promised
    )


def _places(found, joint):
    """Return the indices in qpos of a joint."""
    addresses = [*found.model.jnt_qposadr.tolist(), int(found.model.nq)]
    return range(addresses[joint], addresses[joint + 1])


def _fixed(found, joint):
    places = list(_places(found, joint))
    return all(abs(start[places] - found.starts[0][places]).max() < FAR / 10 for start in found.starts[1:])


def _gap(found, joint):
    place = _farthest(found, joint)
    return abs(found.starts[0][place] - found.held[place])


def _farthest(found, joint):
    return max(_places(found, joint), key=lambda place: abs(found.starts[0][place] - found.held[place]))

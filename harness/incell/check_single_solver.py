"""Check that accelerations do not depend on the way in which the constraint solver stores the Jacobian."""

import numpy as np

from .cell_mujoco import bindings, simulation
from .cell_specification import compares_with_specification, contradiction

STEPS = 50
APART = 1e-3
"""A difference that no rounding explains, as a part of the largest acceleration."""

DENSE, SPARSE = 0, 1
"""mjtJacobian"""


@compares_with_specification
def run(probe, facts):
    """Compare the accelerations that the sparse and the dense Jacobian give, in states of the model's own.

    By MuJoCo's documentation the choice matters to speed alone. A model whose Jacobian is dense, or that is solved in
    another way than Newton's, is not concerned.
    """
    mujoco, model = bindings(), simulation(probe).model
    sparse = bool(mujoco.mj_isSparse(model)) if hasattr(mujoco, "mj_isSparse") else model.nv >= 60
    newton = int(model.opt.solver) == int(mujoco.mjtSolver.mjSOL_NEWTON)
    facts.update(sparse=sparse, newton=newton)
    if not (sparse and newton):
        return None
    data, random = mujoco.MjData(model), np.random.RandomState(0)
    for step in range(STEPS):
        data.ctrl[:] = random.uniform(-1, 1, model.nu)
        mujoco.mj_step(model, data)
        dense, stored = (_accelerations(mujoco, model, data, storage) for storage in (DENSE, SPARSE))
        gap, largest = abs(dense - stored).max(), abs(dense).max()
        if gap > APART * max(1.0, largest):
            return contradiction("solver.differs", at=step + 1, steps=step + 1, gap=float(gap), largest=float(largest))
    return None


def _accelerations(mujoco, model, data, storage):
    """Return the accelerations in a state, computed anew."""
    jacobian = model.opt.jacobian
    other = mujoco.MjData(model)
    for name in ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat"):
        getattr(other, name)[:] = getattr(data, name)
    try:
        model.opt.jacobian = storage
        mujoco.mj_forward(model, other)
    finally:
        model.opt.jacobian = jacobian
    return np.array(other.qacc)

"""Read and set the state of a simulation and advance it, whichever library it belongs to."""

import sys

import numpy as np

from .cell_errors import library, skip
from .cell_sketch import Stages

MUJOCO_STATE = ("qpos", "qvel", "act", "mocap_pos", "mocap_quat", "ctrl")
"""Arrays of mjData that are set, besides the time and the warm start."""

EXACT_ITERATIONS = 100
"""Times as many iterations of the solver, with tolerance 0, as the model asks for."""


def physics_of(env):
    """Return the physics of an opened environment. Skips where no state can be set."""
    raw = getattr(env.raw, "unwrapped", env.raw)
    model, data = getattr(raw, "model", None), getattr(raw, "data", None)
    mujoco = sys.modules.get("mujoco")
    if hasattr(mujoco, "MjModel") and isinstance(model, mujoco.MjModel):
        return MujocoPhysics(mujoco, model, data, raw.step)
    if isinstance(getattr(raw, "state", None), (tuple, list, np.ndarray)):
        return AttributePhysics(raw)
    skip("behave.no_state")
    return None


class AttributePhysics:
    """An environment whose whole state is its attribute `state`, as Gymnasium's classic control tasks have it."""

    parts = ("state",)
    unset = ()
    warm_starts = False
    stages = None

    def __init__(self, raw):
        self.raw = raw
        self.step = raw.step
        values = np.asarray(raw.state)
        self.precision = values.dtype if values.dtype.kind == "f" else np.dtype(float)
        self.is_array = isinstance(raw.state, np.ndarray)

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        return {"state": np.array(self.raw.state, dtype=float).ravel()}

    def write(self, state, _warm=None):
        """Set the state, and forget what an ended episode left."""
        values = np.array(state["state"], dtype=self.precision)
        self.raw.state = values if self.is_array else tuple(float(value) for value in values)
        for name in ("steps_beyond_done", "steps_beyond_terminated"):
            if hasattr(self.raw, name):
                setattr(self.raw, name, None)

    def contacts(self):
        """Return the geometry pairs in contact: none."""
        return ()


class MujocoPhysics:
    """A model and its data of MuJoCo's bindings; `step` is the environment's own."""

    warm_starts = True
    precision = np.dtype(float)

    def __init__(self, mujoco, model, data, step):
        self.mujoco = mujoco
        self.model = model
        self.data = data
        self.step = step
        self.parts = ("time", *(name for name in MUJOCO_STATE if getattr(data, name).size))
        self.unset = tuple(self._unset())
        self.stages = Stages(mujoco, model, data)

    def _unset(self):
        """Yield what a state of this model has that is not set: it stays as the reset left it."""
        for count, name in (("nplugin", "plugin state"), ("neq", "equality flags"), ("nuserdata", "user data")):
            if getattr(self.model, count, 0):
                yield name

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        state = {name: np.array(getattr(self.data, name), dtype=float).ravel() for name in self.parts if name != "time"}
        return dict(state, time=np.array([self.data.time]))

    def warm_start(self):
        """Return the acceleration that the solver starts from."""
        return np.array(self.data.qacc_warmstart)

    def write(self, state, warm=None):
        """Set the state and compute all that depends on it; the solver then starts from `warm`, else from zero."""
        data = self.data
        data.time = float(state["time"][0])
        for name in self.parts[1:]:
            array = getattr(data, name)
            array[...] = state[name].reshape(array.shape)
        data.qfrc_applied[:] = 0
        data.xfrc_applied[:] = 0
        with library:
            self.mujoco.mj_forward(self.model, data)
        data.qacc_warmstart[:] = 0 if warm is None else warm

    def simulate(self):
        """Make one step of the simulator."""
        with library:
            self.mujoco.mj_step(self.model, self.data)

    def exactly(self):
        """Let the solver iterate until nothing changes, inside a `with` block."""
        return _Exactly(self.model.opt)

    def contacts(self):
        """Return the pairs of geometry numbers in contact, sorted, each as often as it has contacts."""
        return tuple(sorted(self.stages.pairs()))


class _Exactly:
    def __init__(self, option):
        self.option = option

    def __enter__(self):
        self.before = self.option.tolerance, self.option.iterations
        self.option.tolerance, self.option.iterations = 0, self.before[1] * EXACT_ITERATIONS

    def __exit__(self, *_error):
        self.option.tolerance, self.option.iterations = self.before

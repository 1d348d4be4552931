"""Read and set the state of a simulation and advance it, whichever library it belongs to."""

import sys

import numpy as np

from .cell_action_space import action_space_of
from .cell_bullet_physics import BulletPhysics, bullet_of
from .cell_errors import library
from .cell_flat import flat
from .cell_functional_physics import functional_physics_of
from .cell_simulations import simulation_of
from .cell_sketch import Stages

MUJOCO_STATE = ("qpos", "qvel", "act", "mocap_pos", "mocap_quat", "ctrl")
"""Arrays of mjData that are set, besides the time and the warm start."""

EXACT_ITERATIONS, NEWTON_ITERATIONS = (1, 3, 100), (1, 3)
"""Times as many iterations of the solver, with tolerance 0, as the model asks for: more while they change a step.

Newton's method ends within some ten iterations; what more of them change is rounding, which grows with their number.
"""


def physics_of(env):
    """Return the physics of an opened environment, which was reset; of one whose state cannot be set, seeded runs."""
    functional = functional_physics_of(env)
    if functional is not None:
        return functional
    raw = getattr(env.raw, "unwrapped", env.raw)
    simulation = simulation_of(env, raw)
    mujoco = sys.modules.get("mujoco")
    if hasattr(mujoco, "MjModel") and isinstance(simulation.model, mujoco.MjModel):
        return MujocoPhysics(mujoco, simulation)
    client = bullet_of(raw)
    if client is not None:
        return BulletPhysics(raw, client)
    if isinstance(getattr(raw, "state", None), (tuple, list, np.ndarray)):
        return AttributePhysics(raw)
    return SeededPhysics(env)


SEEDS, HORIZON = 20, 15
"""Seeds of an environment whose state cannot be set, and steps of each run: rounding grows with every step."""


class SeededPhysics:
    """Runs from seeded resets, of an environment whose state cannot be set: a state is a seed and the actions since.

    What it leads to is what is observed; so a twin differs in the actions before it alone.
    """

    method = "seeded"
    parts = ("seed", "count", "past")
    unset = ("all but the seed and the actions since the reset",)
    warm_starts = False
    pure = False
    stages = None
    precision = np.dtype(float)

    def __init__(self, env):
        self.env = env
        self.space = action_space_of(env)
        self.length = (HORIZON - 1) * self.space.size
        self.present = {"seed": np.zeros(1), "count": np.zeros(1), "past": np.zeros(self.length)}
        self.observation = None

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        return dict(self.present)

    def write(self, state, _warm=None):
        """Reset with the seed, and repeat the actions since."""
        self.present = {name: np.array(state[name], dtype=float) for name in self.parts}
        self.observation = self.env.reset(int(state["seed"][0]))
        for action in np.reshape(state["past"], (HORIZON - 1, -1))[: int(state["count"][0])]:
            self.step(self.space.as_action(action))

    def step(self, action):
        """Make one step."""
        self.observation, reward, terminated, truncated = self.env.step(action)
        return self.observation, reward, terminated, truncated, {}

    def outcome(self):
        """Return the last observation, in place of the state after a step."""
        return flat(self.observation)

    def contacts(self):
        """Return the geometry pairs in contact: none."""
        return ()


class AttributePhysics:
    """An environment whose whole state is its attribute `state`, as Gymnasium's classic control tasks have it."""

    method = "state"
    parts = ("state",)
    unset = ()
    warm_starts = False
    pure = False
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

    def outcome(self):
        """Return the state after a step."""
        return self.read()["state"]

    def contacts(self):
        """Return the geometry pairs in contact: none."""
        return ()


class MujocoPhysics:
    """A model and its data of MuJoCo's bindings; `step` is the environment's own, of so many of the simulator's."""

    method = "state"
    warm_starts = True
    pure = False
    precision = np.dtype(float)

    def __init__(self, mujoco, simulation):
        self.mujoco = mujoco
        self.model = simulation.model
        self.data = simulation.data
        self.step = simulation.step
        self.substeps = simulation.substeps
        self.memory = simulation.memory
        self.arrays = tuple(name for name in MUJOCO_STATE if getattr(self.data, name).size)
        self.parts = ("time", *self.arrays, *(("task",) if self.memory else ()))
        self.unset = (*simulation.unset, *self._unset())
        self.stages = Stages(mujoco, self.model, self.data)
        newton = self.model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
        self.exact_iterations = NEWTON_ITERATIONS if newton else EXACT_ITERATIONS

    def _unset(self):
        """Yield what a state of this model has that is not set: it stays as the reset left it."""
        for count, name in (("nplugin", "plugin state"), ("neq", "equality flags"), ("nuserdata", "user data")):
            if getattr(self.model, count, 0):
                yield name

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        state = {name: np.array(getattr(self.data, name), dtype=float).ravel() for name in self.arrays}
        if self.memory:
            state["task"] = self.memory.read()
        return dict(state, time=np.array([self.data.time]))

    def outcome(self):
        """Return the state after a step, but for the controls and what the task remembers."""
        state = self.read()
        return np.concatenate([state[name] for name in self.parts if name not in ("ctrl", "task")])

    def model_sums(self):
        """Return size and sum of each array of the model; what resets place lies where the same reset put it."""
        if self.memory:
            self.memory.write(self.memory.first)
        return self.stages.model_sums()

    def warm_start(self):
        """Return the acceleration that the solver starts from."""
        return np.array(self.data.qacc_warmstart)

    def write(self, state, warm=None):
        """Set the state and compute all that depends on it; the solver then starts from `warm`, else from zero."""
        data = self.data
        data.time = float(state["time"][0])
        for name in self.arrays:
            array = getattr(data, name)
            array[...] = state[name].reshape(array.shape)
        if self.memory:
            self.memory.write(state["task"])
        data.qfrc_applied[:] = 0
        data.xfrc_applied[:] = 0
        with library:
            self.mujoco.mj_forward(self.model, data)
        data.qacc_warmstart[:] = 0 if warm is None else warm

    def simulate(self):
        """Make one step of the simulator."""
        with library:
            self.mujoco.mj_step(self.model, self.data)

    def exactly(self, times):
        """Let the solver iterate so many times as often as the model says, with tolerance 0, in a `with` block."""
        return _Exactly(self.model.opt, times)

    def contacts(self):
        """Return the pairs of geometry numbers in contact, sorted, each as often as it has contacts."""
        return tuple(sorted(self.stages.pairs()))


class _Exactly:
    def __init__(self, option, times):
        self.option = option
        self.times = times

    def __enter__(self):
        self.before = self.option.tolerance, self.option.iterations
        self.option.tolerance, self.option.iterations = 0, self.before[1] * self.times

    def __exit__(self, *_error):
        self.option.tolerance, self.option.iterations = self.before

"""Set the state of simulations that are pure functions on JAX, MJX and Brax, and step from it.

A state is a value: positions and velocities go in, all else is computed anew from them.
"""

import importlib

import numpy as np


def functional_physics_of(env):
    """Return the physics of an opened environment of MJX or Brax, which was reset; None of any other."""
    if hasattr(env.raw, "pipeline_init"):
        return BraxPhysics(env)
    return MjxPhysics(env) if hasattr(env, "source") else None


class FunctionalPhysics:
    """One world. A subclass has `parts`, which are names of arrays, and makes a state of values of them."""

    method = "state"
    warm_starts = False
    pure = True
    stages = None
    precision = np.dtype(np.float32)
    unset = ()

    def __init__(self, env):
        self.env = env
        self.numpy = importlib.import_module("jax.numpy")

    def present(self):
        """Return the object whose attributes are the parts."""
        raise NotImplementedError

    def place(self, arrays):
        """Go to the state of these arrays of JAX, by name."""
        raise NotImplementedError

    def read(self):
        """Return the state: a dict of one-dimensional arrays of float64."""
        present = self.present()
        return {name: np.array(getattr(present, name), dtype=float).ravel() for name in self.parts}

    def write(self, state, _warm=None):
        """Set the state."""
        self.place({name: self.numpy.asarray(np.asarray(state[name], dtype=np.float32)) for name in self.parts})

    def step(self, action):
        """Make one step: the observation, the reward, both flags, no info."""
        return (*self.env.advance(action), {})

    def outcome(self):
        """Return the state after a step."""
        return np.concatenate(list(self.read().values()))

    def contacts(self):
        """Return the geometry pairs in contact: none are read."""
        return ()


class MjxPhysics(FunctionalPhysics):
    """A model of MJX. The warm start is zero: that of data which were not stepped."""

    unset = ("warm start", "mocap poses", "equality flags", "applied forces")
    positions, velocities = "qpos", "qvel"

    def __init__(self, env):
        super().__init__(env)
        jax = importlib.import_module("jax")
        # A time of weak type would have the step compiled twice.
        env.start = jax.tree_util.tree_map(lambda leaf: jax.numpy.asarray(leaf, dtype=leaf.dtype), env.start)
        self.parts = ("qpos", "qvel") + ("act",) * bool(env.source.na)

    def present(self):
        """Return the data."""
        return self.env.data

    def place(self, arrays):
        """Put the arrays into the data of the start."""
        self.env.data = self.env.start.replace(**arrays)

    def joints(self):
        """Return (first number of the position, is it a free body, the limits or None) of each joint."""
        model = self.env.source
        kinds = {0: "free", 1: "ball"}
        for joint in range(model.njnt):
            kind = kinds.get(int(model.jnt_type[joint]))
            limits = tuple(model.jnt_range[joint]) if model.jnt_limited[joint] and kind is None else None
            yield int(model.jnt_qposadr[joint]), kind, limits


class BraxPhysics(FunctionalPhysics):
    """An environment of Brax: its own `pipeline_init` makes the state of positions and velocities."""

    parts = ("q", "qd")
    positions, velocities = "q", "qd"
    unset = ("all of the pipeline's state that `pipeline_init` does not make of q and qd", "info and metrics")

    def __init__(self, env):
        super().__init__(env)
        self.initialize = importlib.import_module("jax").jit(env.raw.pipeline_init)
        self.start = env.state

    def present(self):
        """Return the state of the pipeline."""
        return self.env.state.pipeline_state

    def place(self, arrays):
        """Make the pipeline's state of the arrays; all else is that of the first reset."""
        self.env.state = self.start.replace(pipeline_state=self.initialize(arrays["q"], arrays["qd"]))

    def joints(self):
        """Return (first number of the position, is it a free body, the limits or None) of each joint."""
        system = self.env.raw.sys
        limits = getattr(system.dof, "limit", None)
        place = speed = 0
        for kind in system.link_types:
            if kind == "f":
                yield place, "free", None
                place, speed = place + 7, speed + 6
                continue
            for _ in range(int(kind)):
                pair = (float(limits[0][speed]), float(limits[1][speed])) if limits is not None else (-np.inf, np.inf)
                yield place, None, pair if np.all(np.isfinite(pair)) else None
                place, speed = place + 1, speed + 1

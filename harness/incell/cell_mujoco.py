"""MuJoCo's own bindings, watched while an environment uses them, whichever library that is of."""

import copy
import sys
from contextlib import contextmanager

import numpy as np

from .cell_episode import single
from .cell_errors import skip

STEPPING = ("mj_step", "mj_step1", "mj_step2")


def bindings():
    """Return the module of MuJoCo's bindings, which the environment has imported."""
    module = sys.modules.get("mujoco")
    if not hasattr(module, "MjModel"):
        skip("mujoco.no_bindings")
    return module


@contextmanager
def watched(names, note):
    """Call `note` with the arguments of each call of these functions of the bindings, after the call."""
    functions = [getattr(bindings(), name, None) for name in names]
    kept = []
    try:
        for name, function in zip(names, functions):
            watching = _watching(function, note)
            for module in list(sys.modules.values()) if function else ():
                if getattr(module, "__dict__", {}).get(name) is function:
                    kept.append((module, name, function))
                    setattr(module, name, watching)
        yield
    finally:
        for module, name, function in kept:
            setattr(module, name, function)


def _watching(function, note):
    def watching(*values, **named):
        result = function(*values, **named)
        note(*values, **named)
        return result

    return watching


def memory(view):
    """Return the values of an array of the bindings as they lie in memory, side by side.

    The bindings before 3.1.4 give arrays whose strides are wrong beside numpy 2.
    """
    import ctypes

    raw = ctypes.string_at(_address(view), view.size * view.dtype.itemsize)
    return np.frombuffer(raw, view.dtype).reshape(view.shape)


def vectors(kind):
    """Return the names of the array-valued properties of a class of the bindings that has no arguments."""
    example = kind()
    names = [name for name in dir(kind) if isinstance(getattr(kind, name), property)]
    return [name for name in names if isinstance(getattr(example, name), np.ndarray)]


def written(kind, name):
    """Tell whether the items of such a property, read back one by one, are the ones that were written."""
    view = getattr(kind(), name)
    values = np.arange(1, view.size + 1).astype(view.dtype)
    view[...] = values.reshape(view.shape)
    return [view.flat[n] for n in range(view.size)] == list(values)


@contextmanager
def mended(kinds):
    """Let the array-valued properties of these classes be arrays whose items are written where they belong."""
    kept = [(kind, name, getattr(kind, name)) for kind in kinds for name in vectors(kind)]
    try:
        for kind, name, found in kept:
            setattr(kind, name, property(_mended(found), found.fset))
        yield
    finally:
        for kind, name, found in kept:
            setattr(kind, name, found)


def _mended(found):
    def get(owner):
        import ctypes

        view = found.fget(owner)
        size = view.size * view.dtype.itemsize
        place = (ctypes.c_char * size).from_address(_address(view))
        place.owner = owner  # the memory is the owner's
        return np.frombuffer(place, view.dtype).reshape(view.shape)

    return get


def _address(view):
    return view.__array_interface__["data"][0]


class Simulation:
    """A copy of the model that an environment simulates, and of its start pose.

    `held` is its own `initial_qpos` after the resets, `starts` the joints' positions after each of them; both are None
    where the environment documents no such thing. `settles` is whether its resets step the simulation.
    """

    def __init__(self, model, held=None, starts=None, settles=False):
        self.model = model
        self.held = held
        self.starts = starts
        self.settles = settles


RESETS = 3


def simulation(probe):
    """Return the simulation of the case's environment; it is made once for all checks of this process."""
    if "simulation" not in probe.memo:
        probe.memo["simulation"] = _simulation(probe)
    return probe.memo["simulation"]


def _simulation(probe):
    calls = []
    with watched(STEPPING, lambda *values, **named: calls.append((values, named))), single(probe) as env:
        env.seed_actions(probe.case["seed"])
        env.reset(probe.case["seed"])
        env.step(env.action())
        if not calls:
            skip("mujoco.no_steps")
        values, named = calls[-1]
        model = copy.copy(values[0] if values else named["m"])
        raw = getattr(env.raw, "unwrapped", env.raw) if hasattr(env, "raw") else None
        if not documents(type(raw), "initial_qpos"):
            return Simulation(model)
        calls.clear()
        starts = []
        for number in range(RESETS):
            env.reset(probe.case["seed"] + number)
            starts.append(np.array(raw.data.qpos))
        return Simulation(model, np.array(raw.initial_qpos), starts, bool(calls))


def documents(kind, argument):
    """Tell whether the documentation of a class, or of one that it is made of, explains this argument."""
    texts = [text for part in kind.__mro__ for text in (part.__doc__, getattr(part.__init__, "__doc__", None)) if text]
    return any(argument + " (" in text or argument + ":" in text for text in texts)

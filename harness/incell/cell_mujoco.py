"""Watch MuJoCo's own bindings while an environment uses them, whichever library the environment belongs to."""

import copy
import sys
from collections import namedtuple
from contextlib import contextmanager

import numpy as np

from .cell_episode import open_single
from .cell_errors import skip

STEPPING = ("mj_step", "mj_step1", "mj_step2")


def bindings():
    """Return the module of MuJoCo's bindings, which the environment has imported."""
    module = sys.modules.get("mujoco")
    if not hasattr(module, "MjModel"):
        skip("mujoco.no_bindings")
    return module


@contextmanager
def watch_calls(names, note):
    """Call `note` with the arguments of each call of these functions of the bindings, after the call."""
    functions = [getattr(bindings(), name, None) for name in names]
    originals = []
    try:
        for name, function in zip(names, functions):
            watching = _calling(function, note)
            for module in list(sys.modules.values()) if function else ():
                if getattr(module, "__dict__", {}).get(name) is function:
                    originals.append((module, name, function))
                    setattr(module, name, watching)
        yield
    finally:
        for module, name, function in originals:
            setattr(module, name, function)


def _calling(function, note):
    def watching(*values, **named):
        result = function(*values, **named)
        note(*values, **named)
        return result

    return watching


def read_memory(view):
    """Return the values of an array of the bindings as they lie in memory, side by side.

    The bindings before 3.1.4 give arrays whose strides are wrong beside numpy 2.
    """
    import ctypes

    raw = ctypes.string_at(_address(view), view.size * view.dtype.itemsize)
    return np.frombuffer(raw, view.dtype).reshape(view.shape)


def array_properties(kind):
    """Return the names of the array-valued properties of a class of the bindings that has no arguments."""
    example = kind()
    names = [name for name in dir(kind) if isinstance(getattr(kind, name), property)]
    return [name for name in names if isinstance(getattr(example, name), np.ndarray)]


def keeps_items(kind, name):
    """Return whether the items of such a property, read back one by one, are the ones that were written."""
    view = getattr(kind(), name)
    values = np.arange(1, view.size + 1).astype(view.dtype)
    view[...] = values.reshape(view.shape)
    return [view.flat[n] for n in range(view.size)] == list(values)


@contextmanager
def patch_arrays(kinds):
    """Let the array-valued properties of these classes be arrays whose items are written where they belong."""
    originals = [(kind, name, getattr(kind, name)) for kind in kinds for name in array_properties(kind)]
    try:
        for kind, name, original in originals:
            setattr(kind, name, property(_getter(original), original.fset))
        yield
    finally:
        for kind, name, original in originals:
            setattr(kind, name, original)


def _getter(original):
    def get(owner):
        import ctypes

        view = original.fget(owner)
        size = view.size * view.dtype.itemsize
        place = (ctypes.c_char * size).from_address(_address(view))
        place.owner = owner  # the memory is the owner's
        return np.frombuffer(place, view.dtype).reshape(view.shape)

    return get


def _address(view):
    return view.__array_interface__["data"][0]


class Simulation(namedtuple("Simulation", ("model", "initial_qpos", "starts", "settles"))):
    """A copy of the model that an environment simulates, and of its start pose.

    `initial_qpos` is the environment's own after the resets, `starts` the joints' positions (qpos) after each of them;
    both are None where the environment documents no such thing. `settles` is whether its resets step the simulation.
    """


RESETS = 3


def simulation(probe):
    """Return the simulation of the case's environment; it is made once for all checks of this process."""
    if "simulation" not in probe.memo:
        probe.memo["simulation"] = _simulation(probe)
    return probe.memo["simulation"]


def _simulation(probe):
    calls = []
    with watch_calls(STEPPING, lambda *values, **named: calls.append((values, named))), open_single(probe) as env:
        env.seed_actions(probe.case["seed"])
        env.reset(probe.case["seed"])
        env.step(env.action())
        if not calls:
            skip("mujoco.no_steps")
        values, named = calls[-1]
        model = copy.copy(values[0] if values else named["m"])
        raw = getattr(env.raw, "unwrapped", env.raw)
        if not documents_argument(type(raw), "initial_qpos"):
            return Simulation(model, None, None, settles=False)
        calls.clear()
        starts = []
        for number in range(RESETS):
            env.reset(probe.case["seed"] + number)
            starts.append(np.array(raw.data.qpos))
        return Simulation(model, np.array(raw.initial_qpos), starts, settles=bool(calls))


def documents_argument(kind, argument):
    """Return whether the documentation of a class, or of one that it is made of, explains this argument."""
    texts = [text for part in kind.__mro__ for text in (part.__doc__, getattr(part.__init__, "__doc__", None)) if text]
    return any(argument + " (" in text or argument + ":" in text for text in texts)

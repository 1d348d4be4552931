"""Phase render: pictures as arrays."""

import ctypes
import os
import sys

import numpy as np

from .cell_episode import single
from .cell_errors import Skip, violate

STEPS = 10
LARGEST = 64 << 20
DRAWERS = ("mujoco", "mujoco_py", "dm_control", "OpenGL", "glfw", "pyglet", "pygame")
NEED_GL = ("mujoco", "mujoco_py", "dm_control", "OpenGL", "glfw", "pyglet")
GL_STRINGS = {"vendor": 0x1F00, "renderer": 0x1F01, "version": 0x1F02}


def rgb_array(probe, facts):
    """Render after the reset and after some steps; both frames are kept."""
    try:
        _render(probe, facts)
    except Skip:
        raise
    except Exception:
        if probe.api.declares_pictures(probe.case):
            raise
        message = "the environment declares no render mode rgb_array"
        raise Skip(message) from None
    finally:
        facts["modules"] = [name for name in DRAWERS if name in sys.modules]
        needed = [name for name in NEED_GL if name in sys.modules]
        if needed:
            facts.setdefault("gl", {})["modules"] = needed


def _render(probe, facts):
    seed = probe.case["seed"]
    with single(probe, draw=True) as env:
        env.seed_actions(seed)
        env.reset(seed)
        frame = env.render()
        gl = _context()
        if gl:
            facts["gl"] = gl
        _examine(probe, facts, frame, "first")
        for _ in range(min(STEPS, probe.case["steps"])):
            values = env.step(env.action())
            if values[2] or values[3]:
                env.reset()
        _examine(probe, facts, env.render(), "last")


def _examine(probe, facts, frame, which):
    """A frame has to be an array (height, width, 3) of uint8 that shows something."""
    if not isinstance(frame, np.ndarray):
        violate("render() returned a {}, not an array", type(frame).__name__)
    if frame.ndim != 3 or frame.shape[2] != 3 or 0 in frame.shape:
        violate("render() returned shape {}, not (height, width, 3)", frame.shape)
    if frame.dtype != np.uint8:
        violate("render() returned dtype {}, not uint8", frame.dtype)
    facts["shape"] = list(frame.shape)
    if frame.nbytes <= LARGEST:
        name = "render.rgb_array-{}.npy".format(which)
        np.save(os.path.join(probe.folder, name), frame, allow_pickle=False)
        probe.frame("render.rgb_array", which, name)
    if bool((frame == frame[0, 0]).all()):
        violate("blank frame: every pixel is {}", [int(v) for v in frame[0, 0]])


def _context():
    """What draws, where a GL context is current; asked through the library that PyOpenGL has loaded already."""
    try:
        loaded = sys.modules["OpenGL.platform"].PLATFORM
        if not loaded.GetCurrentContext():
            return {}
        ask = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_uint)(("glGetString", loaded.GL))
        return {name: (ask(number) or b"").decode("utf-8", "replace") for name, number in GL_STRINGS.items()}
    except Exception:
        return {}


CHECKS = {"render.rgb_array": rgb_array}
FOLLOWERS = {}

"""Find the camera with which a picture was drawn, where it can be read."""

import math
from contextlib import ExitStack, contextmanager

from .cell_mujoco import read_memory, watch_calls

SCENE = 6
"""The place of the scene among the arguments of mjv_updateScene."""


class CameraPose:
    """The pose of the camera that drew last, or None; see `watch_camera`."""

    def __init__(self):
        self.facts = None

    def note(self, *values, **named):
        """Keep the camera of a scene that MuJoCo was asked to draw; where it cannot be read, there is none."""
        try:
            self.facts = _read_camera(named["scn"] if "scn" in named else values[SCENE])
        except Exception:
            self.facts = None


@contextmanager
def watch_camera(env):
    """Note the camera that draws an environment's picture in a block: a `CameraPose`.

    MuJoCo's own bindings are watched; an adapter may have the camera itself. The drawing is left unchanged.
    """
    pose = CameraPose()
    with ExitStack() as watching:
        try:
            watching.enter_context(watch_calls(("mjv_updateScene",), pose.note))
        except Exception:  # nothing of MuJoCo's draws, or its functions cannot be watched
            pose.facts = None
        yield pose
    pose.facts = pose.facts or env.camera_matrices


def _read_camera(scene):
    """Return position, directions and field of view (degrees) of a scene's camera, between its two eyes."""
    eyes = [scene.camera[number] for number in range(2)]
    positions = [read_memory(eye.pos).tolist() for eye in eyes]
    eye = eyes[0]
    pose = {
        "position": [sum(pair) / 2 for pair in zip(*positions)],
        "forward": read_memory(eye.forward).tolist(),
        "up": read_memory(eye.up).tolist(),
    }
    if getattr(eye, "orthographic", 0):
        pose["height"] = float(eye.frustum_top - eye.frustum_bottom)
    else:
        halves = [math.atan2(edge, eye.frustum_near) for edge in (eye.frustum_top, -eye.frustum_bottom)]
        pose["fovy"] = math.degrees(sum(halves))
    numbers = [number for value in pose.values() for number in (value if isinstance(value, list) else [value])]
    return pose if all(math.isfinite(number) for number in numbers) else None

"""Finds out from where a picture was drawn, where that can be had."""

import math
from contextlib import ExitStack, contextmanager

from .cell_mujoco import memory, watched

SCENE = 6
"""The place of the scene among the arguments of mjv_updateScene."""


class Pose:
    """The pose of the camera that drew last, or None; see `seen`."""

    def __init__(self):
        self.facts = None

    def note(self, *values, **named):
        """Keep the camera of a scene that MuJoCo was asked to draw; where it cannot be read, there is none."""
        try:
            self.facts = _camera(named["scn"] if "scn" in named else values[SCENE])
        except Exception:
            self.facts = None


@contextmanager
def seen(env):
    """Note the camera that draws an environment's picture in a block: a `Pose`.

    MuJoCo's own bindings are watched; an adapter may know the camera itself. What draws is left as it is.
    """
    pose = Pose()
    with ExitStack() as watching:
        try:
            watching.enter_context(watched(("mjv_updateScene",), pose.note))
        except Exception:  # nothing of MuJoCo's draws, or its functions cannot be watched
            pose.facts = None
        yield pose
    pose.facts = pose.facts or env.seen_from


def _camera(scene):
    """Return position, directions and field of view (degrees) of a scene's camera, between its two eyes."""
    eyes = [scene.camera[number] for number in range(2)]
    positions = [memory(eye.pos).tolist() for eye in eyes]
    eye = eyes[0]
    found = {
        "position": [sum(pair) / 2 for pair in zip(*positions)],
        "forward": memory(eye.forward).tolist(),
        "up": memory(eye.up).tolist(),
    }
    if getattr(eye, "orthographic", 0):
        found["height"] = float(eye.frustum_top - eye.frustum_bottom)
    else:
        halves = [math.atan2(edge, eye.frustum_near) for edge in (eye.frustum_top, -eye.frustum_bottom)]
        found["fovy"] = math.degrees(sum(halves))
    numbers = [number for value in found.values() for number in (value if isinstance(value, list) else [value])]
    return found if all(math.isfinite(number) for number in numbers) else None

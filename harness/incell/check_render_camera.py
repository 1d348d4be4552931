"""Check that the camera that drew a picture looks where the environment pointed it."""

import numpy as np

from .cell_episode import open_single
from .cell_errors import skip
from .cell_mujoco import array_properties, bindings, keeps_items, patch_arrays, read_memory, watch_calls
from .cell_specification import compares_with_specification, contradiction

FREE, TRACKING, FIXED = range(3)
"""mjtCamera"""

FRAMES = 60
"""Pictures in which a tracking camera has to come to the body that it follows."""

MIDDLE = 0.5
"""The largest distance of a followed body from the middle of its picture, as a fraction of half its height."""


@compares_with_specification
def run(probe, facts):
    """Compare the scene of the last picture with the one that the environment wrote.

    A free camera looks at its `lookat`, a tracking one at the body that it follows. A camera fixed in the
    model is the model's own. The environment wrote the scene that it draws if each item is written where it belongs;
    that scene has to be drawn only where items are lost, which read back as others.
    """
    mujoco = bindings()
    scene = _draw(probe)
    facts["camera"] = {"kind": scene.kind, "lookat": scene.lookat, "position": scene.position}
    kinds = (mujoco.MjvCamera, mujoco.MjvOption)
    lost = [name for kind in kinds for name in array_properties(kind) if not keeps_items(kind, name)]
    facts["lost"] = lost
    intended = scene
    if lost:
        with patch_arrays(kinds):
            intended = _draw(probe)
    if scene.kind == TRACKING:
        return _compare_position(scene)
    if scene.kind == FREE and not np.allclose(scene.lookat, intended.lookat, atol=1e-6):
        return contradiction("camera.lookat", got=_format_point(scene.lookat), promised=_format_point(intended.lookat))
    if scene.things != intended.things:
        names = [name for name in intended.options if scene.options[name] != intended.options[name]]
        for name in names:
            got, promised = str(scene.options[name]), str(intended.options[name])
            return contradiction("camera.options", name=name, got=got, promised=promised)
    if scene.kind != FREE:
        skip("camera.fixed")
    return None


class DrawnScene:
    """A scene as MuJoCo was asked to draw it: the camera and its pose, the options, and things by kind and number."""

    def __init__(self, m, d, opt, pert, cam, catmask, scn):  # noqa: PLR0913, PLR0917 - as the bindings name them
        self.kind = int(cam.type)
        self.lookat = read_memory(cam.lookat).tolist()
        self.options = {name: read_memory(getattr(opt, name)).tolist() for name in array_properties(type(opt))}
        self.things = [(int(scn.geoms[n].objtype), int(scn.geoms[n].objid)) for n in range(scn.ngeom)]
        eyes = [scn.camera[number] for number in range(2)]
        self.position = np.mean([read_memory(eye.pos) for eye in eyes], axis=0).tolist()
        self.forward, self.up = (read_memory(getattr(eyes[0], name)).astype(float) for name in ("forward", "up"))
        self.half_height = eyes[0].frustum_top / eyes[0].frustum_near
        followed = int(cam.trackbodyid) if self.kind == TRACKING else 0
        self.bodies = [np.array(d.xpos[followed]), np.array(d.subtree_com[followed])]


def _draw(probe):
    """Draw with an environment of its own and return its last scene, once a tracking camera has reached its body."""
    scenes = []
    watching = watch_calls(("mjv_updateScene",), lambda *values, **named: scenes.append(DrawnScene(*values, **named)))
    with watching, open_single(probe, draw=True) as env:
        env.seed_actions(probe.case["seed"])
        env.reset(probe.case["seed"])
        env.render()
        while 0 < len(scenes) < FRAMES and _still_moves(scenes):
            env.render()
    if not scenes:
        skip("unmeasured.camera")
    return scenes[-1]


def _still_moves(scenes):
    """Return whether a tracking camera still moves to its body: before MuJoCo 3, a fifth of the way in each picture."""
    before = scenes[-2].lookat if len(scenes) > 1 else None
    return scenes[-1].kind == TRACKING and (before is None or not np.allclose(before, scenes[-1].lookat, atol=1e-3))


def _compare_position(scene):
    """Return a contradiction where the body that the camera follows is not near the middle of the picture."""
    places = [_place(scene, body) for body in scene.bodies]
    if any(place is not None and max(abs(place)) <= MIDDLE for place in places):
        return None
    if places[0] is None:
        return contradiction("camera.behind")
    right, above = map(float, places[0])
    return contradiction("camera.aside", right=right, above=above)


def _place(scene, body):
    """Return where a point is in the picture, in halves of its height to the right and above; None behind it."""
    direction = body - scene.position
    depth = scene.forward @ direction
    if depth <= 0:
        return None
    return np.array([np.cross(scene.forward, scene.up) @ direction, scene.up @ direction]) / (depth * scene.half_height)


def _format_point(point):
    return "({})".format(", ".join("{:.3g}".format(value) for value in point))

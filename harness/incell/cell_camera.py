"""Cameras: whether the one that drew a picture looks where it was told to."""

import numpy as np

from .cell_episode import single
from .cell_errors import skip
from .cell_misleading import contradiction, misleading
from .cell_mujoco import bindings, memory, mended, vectors, watched, written

FREE, TRACKING, FIXED = range(3)
"""mjtCamera"""

FRAMES = 60
"""Pictures in which a tracking camera has to come to the body that it follows."""

MIDDLE = 0.5
"""The largest distance of a followed body from the middle of its picture, as a fraction of half its height."""


@misleading
def camera(probe, facts):
    """Compare what the last picture was drawn with and what the environment wrote.

    A free camera looks at what its `lookat` was told, a tracking one at the body that it follows. A camera fixed in the
    model is the model's own. What the environment wrote is what it would have drawn with if each item were written
    where it belongs: only where items read back are others has that to be drawn.
    """
    mujoco = bindings()
    drawn = _drawn(probe)
    facts["camera"] = {"kind": drawn.kind, "lookat": drawn.lookat, "position": drawn.position}
    kinds = (mujoco.MjvCamera, mujoco.MjvOption)
    lost = [name for kind in kinds for name in vectors(kind) if not written(kind, name)]
    facts["lost"] = lost
    meant = drawn
    if lost:
        with mended(kinds):
            meant = _drawn(probe)
    if drawn.kind == TRACKING:
        return _aside(drawn)
    if drawn.kind == FREE and not np.allclose(drawn.lookat, meant.lookat, atol=1e-6):
        return contradiction("camera.lookat", got=_shown(drawn.lookat), promised=_shown(meant.lookat))
    if drawn.things != meant.things:
        names = [name for name in meant.options if drawn.options[name] != meant.options[name]]
        for name in names:
            got, promised = str(drawn.options[name]), str(meant.options[name])
            return contradiction("camera.options", name=name, got=got, promised=promised)
    if drawn.kind != FREE:
        skip("camera.fixed")
    return None


class Drawn:
    """A scene as MuJoCo was asked to draw it: the camera and its pose, the options, and things by kind and number."""

    def __init__(self, m, d, opt, pert, cam, catmask, scn):  # noqa: PLR0913, PLR0917 - as the bindings name them
        self.kind = int(cam.type)
        self.lookat = memory(cam.lookat).tolist()
        self.options = {name: memory(getattr(opt, name)).tolist() for name in vectors(type(opt))}
        self.things = [(int(scn.geoms[n].objtype), int(scn.geoms[n].objid)) for n in range(scn.ngeom)]
        eyes = [scn.camera[number] for number in range(2)]
        self.position = np.mean([memory(eye.pos) for eye in eyes], axis=0).tolist()
        self.forward, self.up = (memory(getattr(eyes[0], name)).astype(float) for name in ("forward", "up"))
        self.half = eyes[0].frustum_top / eyes[0].frustum_near
        followed = int(cam.trackbodyid) if self.kind == TRACKING else 0
        self.bodies = [np.array(d.xpos[followed]), np.array(d.subtree_com[followed])]


def _drawn(probe):
    """Draw with an environment of its own, and return what with: a camera that follows a body is let come to it."""
    found = []
    watching = watched(("mjv_updateScene",), lambda *values, **named: found.append(Drawn(*values, **named)))
    with watching, single(probe, draw=True) as env:
        env.seed_actions(probe.case["seed"])
        env.reset(probe.case["seed"])
        env.render()
        while 0 < len(found) < FRAMES and _moves(found):
            env.render()
    if not found:
        skip("unmeasured.camera")
    return found[-1]


def _moves(found):
    """Tell whether a tracking camera still moves to its body: before MuJoCo 3, a fifth of the way in each picture."""
    before = found[-2].lookat if len(found) > 1 else None
    return found[-1].kind == TRACKING and (before is None or not np.allclose(before, found[-1].lookat, atol=1e-3))


def _aside(drawn):
    """Return a contradiction where the body that the camera follows is not near the middle of the picture."""
    places = [_place(drawn, body) for body in drawn.bodies]
    if any(place is not None and max(abs(place)) <= MIDDLE for place in places):
        return None
    if places[0] is None:
        return contradiction("camera.behind")
    right, above = map(float, places[0])
    return contradiction("camera.aside", right=right, above=above)


def _place(drawn, body):
    """Return where a point is in the picture, in halves of its height to the right and above; None behind it."""
    way = body - drawn.position
    depth = drawn.forward @ way
    if depth <= 0:
        return None
    return np.array([np.cross(drawn.forward, drawn.up) @ way, drawn.up @ way]) / (depth * drawn.half)


def _shown(point):
    return "({})".format(", ".join("{:.3g}".format(value) for value in point))

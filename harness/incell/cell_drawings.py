"""Draw an environment at a set state, and note what the drawing is made of: camera, lights, things, their looks."""

import hashlib
import zlib
from contextlib import ExitStack, contextmanager

import numpy as np

from .cell_camera_pose import SCENE, watch_camera
from .cell_errors import violate
from .cell_mujoco import read_memory, watch_calls
from .cell_pictures import is_same
from .cell_sketch import sketch

MOST_DRAWINGS = 60
"""Drawings in which a camera has to come to the body that it follows: before MuJoCo 3, a fifth of the way in each."""

FIELDS = 48
"""Fields along the longer side of a small picture, each with the mean colour of the pixels in it."""

LIGHT = (
    "ambient", "diffuse", "specular", "attenuation", "cutoff", "exponent", "castshadow", "headlight", "intensity",
    "bulbradius",
)  # fmt: skip
PLACES = ("pos", "dir")
"""Properties of a light in a scene. A headlight's places are the camera's."""

THING = ("type", "dataid", "size", "pos", "mat")
COLOURS = ("rgba", "emission", "specular", "shininess", "reflectance")
"""Properties of a geometry in a scene: its form and place, and its looks."""

TEXTURES = (
    "tex_type", "tex_height", "tex_width", "tex_nchannel", "tex_colorspace", "mat_texid", "mat_texuniform",
    "mat_texrepeat",
)  # fmt: skip
TEXELS = ("tex_data", "tex_rgb")
"""Arrays of the model: the later and the earlier name of the pixels of all textures."""

SETTINGS = ("map", "quality", "rgba", "scale")
"""Parts of the visual settings of a model; the headlight is one of the lights."""


class SceneWatch:
    """The scene that MuJoCo was asked to draw last, or None."""

    def __init__(self):
        self.scene = None

    def note(self, *values, **named):
        """Keep a scene that MuJoCo was asked to draw."""
        self.scene = named["scn"] if "scn" in named else values[SCENE]


class Artist:
    """Draws one environment, and notes what the drawing is made of."""

    def __init__(self, env, model):
        self.env = env
        self.model = model

    def draw(self):
        """Draw until two drawings are equal, and return the picture, its contents, and the drawings that it took."""
        with watch_scene() as watch, watch_camera(self.env) as pose:
            picture, count = self._picture(), 0
            while count < MOST_DRAWINGS:
                count += 1
                again = self._picture()
                if is_same(picture, again):
                    break
                picture = again
        contents = {"drawings": count, "camera": pose.facts}
        if watch.scene is not None:
            contents.update(read_scene(watch.scene))
        return again, contents

    def _picture(self):
        picture = self.env.render()
        if not isinstance(picture, np.ndarray):
            violate("render.not_array", got=type(picture).__name__)
        if picture.ndim != 3 or picture.shape[2] not in (3, 4) or 0 in picture.shape:
            violate("render.shape", got=str(picture.shape), promised="(height, width, 3)")
        if picture.dtype != np.uint8:
            violate("render.dtype", got=str(picture.dtype), promised="uint8")
        return picture[:, :, :3].copy()

    def describe(self):
        """Return textures and visual settings of the model, empty where there is none of MuJoCo's."""
        return {"textures": self._textures(), "settings": self._settings()} if self.model is not None else {}

    def _textures(self):
        sums = {name: summary([getattr(self.model, name)]) for name in TEXTURES if hasattr(self.model, name)}
        texels = [np.array(getattr(self.model, name)) for name in TEXELS if hasattr(self.model, name)]
        for values in texels[:1]:
            sums["pixels"] = [int(values.size), float(zlib.crc32(values.astype(np.uint8).tobytes()))]
        return sums

    def _settings(self):
        sums = {}
        for owner, part in [(self.model.vis, part) for part in SETTINGS] + [(self.model, "stat")]:
            values = getattr(owner, part, None)
            for name in dir(values):
                number = getattr(values, name)
                if not name.startswith("_") and isinstance(number, (int, float, np.ndarray)):
                    sums["{}.{}".format(part, name)] = summary([number])
        return sums


@contextmanager
def watch_scene():
    """Note the scene that is drawn in a block: a `SceneWatch`, without a scene where MuJoCo's bindings draw nothing."""
    watch = SceneWatch()
    with ExitStack() as watching:
        try:
            watching.enter_context(watch_calls(("mjv_updateScene",), watch.note))
        except Exception:  # nothing of MuJoCo's draws
            watch.scene = None
        yield watch


def read_scene(scene):
    """Return size and sum of each property of the lights and the geometries of a scene, by name."""
    lights = [scene.lights[number] for number in range(scene.nlight)]
    geoms = [scene.geoms[number] for number in range(scene.ngeom)]
    geoms.sort(key=lambda geom: (int(geom.objtype), int(geom.objid), int(geom.type)))
    placed = [light for light in lights if not light.headlight]
    sums = {
        "lights": dict(_properties(lights, LIGHT), count=[1, float(len(lights))], **_properties(placed, PLACES)),
        "things": dict(_properties(geoms, THING), count=[1, float(len(geoms))]),
        "colours": _properties(geoms, COLOURS),
    }
    if hasattr(scene, "flags"):
        sums["flags"] = {"flags": summary([scene.flags])}
    return sums


def _properties(owners, names):
    """Return size and sum of each property that all of these have, one after another."""
    return {
        name: summary([getattr(owner, name) for owner in owners])
        for name in names
        if owners and all(hasattr(owner, name) for owner in owners)
    }


def summary(values):
    """Return how many numbers these are, and their sum with fixed weights."""
    numbers = [np.ravel(read_memory(value) if isinstance(value, np.ndarray) else value) for value in values]
    together = np.concatenate(numbers).astype(float)
    return [int(together.size), float(sketch(together))]


def digest(picture):
    """Return the SHA-256 of the pixels as 32 numbers."""
    return np.frombuffer(hashlib.sha256(np.ascontiguousarray(picture).tobytes()).digest(), np.uint8)


def small(picture):
    """Return the mean colour of each field of a picture; one that has few pixels is returned as it is."""
    most = max(picture.shape[:2])
    if most <= FIELDS:
        return picture
    parts = [np.linspace(0, size, max(1, round(FIELDS * size / most)) + 1).astype(int) for size in picture.shape[:2]]
    sums = picture.astype(np.int64)
    for axis, edges in enumerate(parts):
        sums = np.add.reduceat(sums, edges[:-1], axis=axis)
    pixels = np.diff(parts[0])[:, None, None] * np.diff(parts[1])[None, :, None]
    return np.round(sums / pixels).astype(np.uint8)

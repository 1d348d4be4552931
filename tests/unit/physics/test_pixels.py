"""Pictures of two cells: what is seen of a difference, and what of their making moved."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from harness.model import replace
from harness.physics import pixels
from harness.physics.outputs import Array
from harness.physics.pixel_sentences import describe
from harness.physics.pixels import Drawing, Drawings, compare
from harness.physics.relation import Look, Part, PixelComparison

EYE = {"position": [0.0, -3.0, 1.0], "forward": [0.0, 1.0, 0.0], "up": [0.0, 0.0, 1.0], "fovy": [45.0]}
SCENE = {
    "camera": EYE,
    "lights": {"count": [1, 2.0], "diffuse": [6, 1.5]},
    "things": {"count": [1, 9.0], "pos": [27, 4.0]},
    "colours": {"rgba": [36, 2.5]},
}
MODEL = {"textures": {"pixels": [300, 12345.0]}, "settings": {"map.znear": [1, 0.01]}}


def picture() -> Array:
    """Return the fields of a picture of many colours."""
    return np.random.RandomState(3).randint(40, 200, (48, 48, 3)).astype(float)


def drawing(fields: Array | None = None, **parts: dict[str, Sequence[float]]) -> Drawing:
    """Return one drawing; its digest is that of its fields."""
    fields = picture() if fields is None else fields
    return Drawing(shape=(480, 480, 3), digest=str(hash(fields.tobytes())), fields=fields, parts={**SCENE, **parts})


def drawings(*by_state: Drawing, unrepeated: Sequence[int] = (), **parts: dict[str, Sequence[float]]) -> Drawings:
    """Return the drawings of a cell, by the number of their state."""
    numbered = dict(enumerate(by_state or (drawing(), drawing())))
    return Drawings(
        subject="bank", by_state=numbered, unrepeated=frozenset(unrepeated), parts={**MODEL, **parts}, renderer="soft"
    )


def brighter(levels: float, share: float = 1.0) -> Array:
    """Return the picture with a share of its fields brighter."""
    fields = picture().reshape(-1, 3)
    fields[: round(share * len(fields))] += levels
    return fields.reshape(48, 48, 3)


def test_equal_digests_are_identical() -> None:
    """No field is looked at."""
    assert compare(drawings(), drawings()) == PixelComparison(kind=Look.IDENTICAL, compared=tuple(Part)[:-1])


@pytest.mark.parametrize(
    ("fields", "kind"),
    [
        (brighter(1), Look.IMPERCEPTIBLE),
        (brighter(60, share=1 / 2304), Look.IMPERCEPTIBLE),
        (brighter(60, share=0.002), Look.CHANGED),
        (brighter(20), Look.CHANGED),
    ],
    ids=["one level", "one pixel", "some fields", "all fields"],
)
def test_a_difference_counts_where_people_see_it(fields: Array, kind: Look) -> None:
    """One level of 255 everywhere, and one field of two thousand, are not seen."""
    found = compare(drawings(), drawings(drawing(), drawing(fields)))
    assert (found.kind, found.looks_same) == (kind, kind is Look.IMPERCEPTIBLE)
    assert found.moved == (Part.DRAWING,)


@pytest.mark.parametrize(
    ("name", "numbers", "part"),
    [
        ("camera", {**EYE, "position": [0.0, -3.1, 1.0]}, Part.CAMERA),
        ("camera", {**EYE, "fovy": [50.0]}, Part.LENS),
        ("lights", {"count": [1, 3.0]}, Part.LIGHTS),
        ("lights", {"diffuse": [6, 1.4]}, Part.LIGHTS),
        ("things", {"pos": [27, 4.1]}, Part.THINGS),
        ("colours", {"rgba": [36, 2.4]}, Part.COLOURS),
    ],
)
def test_the_part_that_moved_is_named(name: str, numbers: dict[str, Sequence[float]], part: Part) -> None:
    """Camera, lens, lights, things and colours are told apart."""
    found = compare(drawings(), drawings(drawing(), drawing(brighter(20), **{name: numbers})))
    assert (found.kind, found.moved) == (Look.CHANGED, (part,))


@pytest.mark.parametrize(
    ("name", "numbers", "part"),
    [("textures", {"pixels": [300, 54321.0]}, Part.TEXTURES), ("settings", {"map.znear": [1, 0.1]}, Part.SETTINGS)],
)
def test_a_part_of_the_model_that_moved_is_named(name: str, numbers: dict[str, Sequence[float]], part: Part) -> None:
    """Textures and visual settings belong to all pictures."""
    found = compare(drawings(), drawings(drawing(), drawing(brighter(20)), **{name: numbers}))
    assert found.moved == (part,)


def test_a_setting_that_no_picture_depends_on_moves_nothing() -> None:
    """MuJoCo 3.0 gave the marks of cameras another colour, and draws none unless it is asked to."""
    mark = {"map.znear": [1, 0.01], "rgba.camera": [4, 0.5]}
    first = drawings(settings={**mark, "rgba.camera": [4, 0.7]})
    assert compare(first, drawings(drawing(), drawing(brighter(20)), settings=mark)).moved == (Part.DRAWING,)


def test_rounding_and_another_layout_move_nothing() -> None:
    """Scenes hold numbers of 32 bits, and releases lay out the same arrays in other sizes."""
    rounded = {**EYE, "position": [1e-7, -3.0000002, 1.0]}
    longer = {"count": [1, 2.0], "diffuse": [8, 9.0]}
    found = compare(drawings(), drawings(drawing(), drawing(brighter(20), camera=rounded, lights=longer)))
    assert found.moved == (Part.DRAWING,)


def test_textures_are_not_called_the_same_where_one_release_knows_no_colour_space() -> None:
    """MuJoCo 3.3.3 draws files that are marked as sRGB darker, from the same texels."""
    texels = MODEL["textures"]
    file, own = ({**texels, "tex_colorspace": [1, space]} for space in (2.0, 0.0))
    darker = drawing(), drawing(brighter(-20))
    found = compare(drawings(), drawings(*darker, textures=file))
    assert (found.moved, Part.TEXTURES in found.compared) == ((), False)
    assert compare(drawings(), drawings(*darker, textures=own)).moved == (Part.DRAWING,)
    assert compare(drawings(textures=own), drawings(*darker, textures=file)).moved == (Part.TEXTURES,)


def test_the_drawing_is_not_blamed_where_little_is_known() -> None:
    """With the camera alone, lights or colours may have moved."""
    bare = Drawing(shape=(480, 480, 3), digest="a", fields=picture(), parts={"camera": EYE})
    other = replace(bare, digest="b", fields=brighter(20))
    found = compare(replace(drawings(bare), parts={}), replace(drawings(other), parts={}))
    assert (found.moved, found.compared) == ((), (Part.CAMERA, Part.LENS, Part.RENDERER))
    assert describe(found).endswith("; with the same camera and lens")


def test_a_picture_that_does_not_repeat_is_never_called_the_same() -> None:
    """A change can be shown by the other states, sameness cannot."""
    loose = drawings(drawing(), drawing(), unrepeated=[1])
    assert compare(drawings(), loose).kind is Look.NONDETERMINISTIC
    changed = drawings(drawing(brighter(20)), drawing(), unrepeated=[1])
    assert compare(drawings(), changed).kind is Look.CHANGED
    assert compare(drawings(), drawings(drawing(), drawing(), unrepeated=[0, 1])).kind is Look.NONDETERMINISTIC


def test_pictures_of_other_subjects_are_not_compared() -> None:
    """Another bank, another start, no picture of the same state, or no kept frame."""
    assert compare(drawings(), replace(drawings(), subject="other")).kind is Look.NOT_COMPARABLE
    start, rounded, far = (replace(drawings(), subject=np.array([1.0, value])) for value in (2.0, 2.0 + 1e-9, 2.1))
    assert compare(start, rounded).kind is Look.IDENTICAL
    assert compare(start, far).kind is Look.NOT_COMPARABLE
    assert compare(start, drawings()).kind is Look.NOT_COMPARABLE
    assert compare(drawings(), replace(drawings(), by_state={7: drawing()})).kind is Look.NOT_COMPARABLE
    unseen = replace(drawing(), digest="b", fields=None)
    assert compare(drawings(), drawings(unseen, unseen)).kind is Look.NOT_COMPARABLE
    assert compare(drawings(), drawings(*[replace(unseen, shape=(9, 9, 3))] * 2)).kind is Look.OTHER_SIZE


def test_letters_tell_what_looks_different_and_primes_what_is_not_equal() -> None:
    """A prime is no other look; what cannot be compared has a question mark."""
    cells = {
        "1": drawings(),
        "2": drawings(drawing(), drawing(brighter(1))),
        "3": drawings(drawing(), drawing(brighter(30))),
        "4": drawings(),
        "5": replace(drawings(), subject="other"),
    }
    letters = pixels.families(list(cells), lambda one, other: compare(cells[one], cells[other]))
    assert letters == {"1": "a", "2": "a'", "3": "b", "4": "a", "5": "?"}


def test_distances_of_colours_are_those_of_cielab() -> None:
    """White is 100, a red of sRGB is at (53.2, 80.1, 67.2), and equal steps of grey are about equally far apart."""
    assert pixels.lab(np.array([255, 255, 255])) == pytest.approx([100, 0, 0], abs=0.01)
    assert pixels.lab(np.array([255, 0, 0])) == pytest.approx([53.24, 80.09, 67.20], abs=0.02)
    greys = pixels.lab(np.array([[level] * 3 for level in range(60, 200, 20)]))[:, 0]
    steps = [after - before for before, after in pairwise(greys)]
    assert max(steps) < 1.2 * min(steps)


def test_a_picture_is_looked_at_in_fields() -> None:
    """A field is the mean of its pixels; the last ones may be smaller, and a small picture stays as it is."""
    picture = np.arange(100 * 60 * 3).reshape(100, 60, 3)
    fields = pixels.fields(picture)
    assert fields.shape == (34, 20, 3)
    assert fields[0, 0] == pytest.approx(picture[:3, :3].mean(axis=(0, 1)))
    assert fields[-1, -1] == pytest.approx(picture[99:, 57:].mean(axis=(0, 1)))
    small = np.zeros((48, 20, 3))
    assert pixels.fields(small) is small

"""Compare what two cells drew of the same states: to the bit, then as people see it, then what moved.

People see colours, not bits. So each field of a picture, the mean of some ten by ten pixels, is taken to CIELAB, where
equal distances look about equally large, and two fields differ visibly from a distance of 2.3 on, which half of all
people just notice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from string import ascii_lowercase

import numpy as np

from harness.physics.outputs import Array
from harness.physics.relation import JUST_NOTICEABLE, Look, Part, PixelComparison

VISIBLE_SHARE = 0.001
"""The share of the fields of a picture that have to differ visibly before the picture does."""

FIELDS = 48
"""Fields along the longer side of a picture, at most."""

SAME_NUMBER, SAME_SUM = 1e-6, 1e-5
"""Difference of a number of a camera, and of a sum over a scene, that is rounding: scenes hold numbers of 32 bits."""

SAME_START = 1e-6
"""Difference of an observation that is rounding: some are float32."""

SETTINGS = (
    "flags", "rgba.fog", "rgba.haze", "stat.extent", "stat.center",
    *(f"map.{name}" for name in ("znear", "zfar", "fogstart", "fogend", "haze", "shadowclip", "shadowscale")),
    *(f"quality.{name}" for name in ("shadowsize", "offsamples", "numslices", "numstacks", "numquads")),
)  # fmt: skip
"""Visual settings that a plain picture depends on. The others are of marks such as those of cameras and contacts:
where these are drawn, they are things of the scene, with colours of their own."""

CAMERA, LENS = ("position", "forward", "up", "view"), ("fovy", "height", "lens")


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """One picture: the shape and digest of all its pixels, and the mean colours of its fields, or None.

    `parts` has the numbers of each part of its making that could be read: lists by name, of a sum its size and value.
    """

    shape: tuple[int, ...]
    digest: str
    fields: Array | None
    parts: Mapping[str, Mapping[str, Sequence[float]]]


@dataclass(frozen=True, kw_only=True)
class Drawings:
    """The pictures of one case in one cell, by state.

    `subject` is what was drawn, the name of a bank or an observation: pictures of other subjects are not compared.
    `unrepeated` are the states whose picture was another one the second time. `parts` are those that belong to all
    pictures.
    """

    subject: Array | str
    by_state: Mapping[int, Drawing]
    unrepeated: frozenset[int]
    parts: Mapping[str, Mapping[str, Sequence[float]]]
    renderer: str = ""


def compare(first: Drawings, second: Drawings) -> PixelComparison:
    """Compare the pictures of two cells."""
    states = sorted(first.by_state.keys() & second.by_state.keys())
    if not states or not _same_subject(first.subject, second.subject):
        return PixelComparison(kind=Look.NOT_COMPARABLE)
    unrepeated = first.unrepeated | second.unrepeated
    pairs = [(first.by_state[state], second.by_state[state]) for state in states if state not in unrepeated]
    if not pairs:
        return PixelComparison(kind=Look.NONDETERMINISTIC)
    parts = [_parts(left, right, first, second) for left, right in pairs]
    compared = tuple(part for part in Part if any(part in one for one in parts))
    moved = tuple(part for part in compared if any(one.get(part) for one in parts))
    kind, shares, distance = _look(pairs)
    if unrepeated and kind in {Look.IDENTICAL, Look.IMPERCEPTIBLE}:
        kind = Look.NONDETERMINISTIC  # a change can be shown without the pictures that are left out, sameness cannot
    if kind is not Look.IDENTICAL and not moved and {*Part} - {Part.RENDERER, Part.DRAWING} <= {*compared}:
        moved = (Part.DRAWING,)
    median = float(np.median(shares)) if shares else 0.0
    return PixelComparison(
        kind=kind, share=max(shares, default=0.0), median=median, distance=distance, moved=moved, compared=compared
    )


def _same_subject(first: Array | str, second: Array | str) -> bool:
    """Return whether two pictures show the same: equal names, or observations that are equal up to rounding."""
    if isinstance(first, str) or isinstance(second, str):
        return isinstance(first, str) and isinstance(second, str) and first == second
    return first.shape == second.shape and bool(np.allclose(first, second, rtol=SAME_START, atol=SAME_START))


def _look(pairs: Sequence[tuple[Drawing, Drawing]]) -> tuple[Look, list[float], float]:
    """Return how pairs of pictures look, the share of each that looks different, and the largest mean distance."""
    if all(left.digest == right.digest and left.shape == right.shape for left, right in pairs):
        return Look.IDENTICAL, [], 0.0
    if any(left.shape != right.shape for left, right in pairs):
        return Look.OTHER_SIZE, [], 0.0
    distances = []
    for left, right in pairs:
        if left.digest == right.digest:
            distances.append(np.zeros(1))
        elif left.fields is None or right.fields is None or left.fields.shape != right.fields.shape:
            return Look.NOT_COMPARABLE, [], 0.0
        else:
            distances.append(np.linalg.norm(lab(left.fields) - lab(right.fields), axis=-1))
    shares = [float((distance > JUST_NOTICEABLE).mean()) for distance in distances]
    kind = Look.CHANGED if max(shares) >= VISIBLE_SHARE else Look.IMPERCEPTIBLE
    return kind, shares, max(float(distance.mean()) for distance in distances)


def fields(picture: Array) -> Array:
    """Return the mean colour of each field of a picture (height, width, 3), at most `FIELDS` along its longer side."""
    side = -(-max(picture.shape[:2]) // FIELDS)
    if side <= 1:
        return picture
    sums = picture.astype(float)
    for axis in (0, 1):
        edges = np.arange(0, picture.shape[axis], side)
        counts = np.diff([*edges, picture.shape[axis]])
        sums = np.add.reduceat(sums, edges, axis=axis) / np.expand_dims(counts, axis=(1 - axis, 2))
    return sums


# --- colours ---------------------------------------------------------------------------------------------------

TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.119192, 0.9503041]]
)
"""From linear sRGB to XYZ."""


def lab(colours: Array) -> Array:
    """Return colours of sRGB, 0 to 255, in CIELAB, for the white that a screen shows."""
    levels = np.asarray(colours, dtype=float) / 255.0
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    ratios = linear @ TO_XYZ.T / TO_XYZ.sum(axis=1)
    bent = np.where(ratios > (6 / 29) ** 3, np.cbrt(ratios), ratios / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(bent, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


# --- what moved ------------------------------------------------------------------------------------------------


def _parts(left: Drawing, right: Drawing, first: Drawings, second: Drawings) -> dict[Part, bool]:
    """Return whether each part that is known of both pictures differs."""
    camera = left.parts.get("camera", {}), right.parts.get("camera", {})
    differing = {
        Part.CAMERA: _moved(*camera, CAMERA),
        Part.LENS: _moved(*camera, LENS),
        **{part: _moved(left.parts.get(part, {}), right.parts.get(part, {})) for part in SCENE},
        Part.TEXTURES: _textures(first.parts.get("textures", {}), second.parts.get("textures", {})),
        Part.SETTINGS: _moved(
            {**left.parts.get("flags", {}), **first.parts.get("settings", {})},
            {**right.parts.get("flags", {}), **second.parts.get("settings", {})},
            SETTINGS,
        ),
        Part.RENDERER: first.renderer != second.renderer if first.renderer and second.renderer else None,
    }
    return {part: bool(moved) for part, moved in differing.items() if moved is not None}


def _textures(left: Mapping[str, Sequence[float]], right: Mapping[str, Sequence[float]]) -> bool | None:
    """Return whether textures differ; None also where they may be read in other colour spaces.

    MuJoCo before 3.3.3 has no colour spaces: it draws the same texels of a file that is marked as sRGB brighter.
    """
    moved = _moved(left, right)
    spaces = [textures.get(COLOUR_SPACES) for textures in (left, right)]
    known_of_one = None in spaces and any(space is not None and space[-1] != 0 for space in spaces)
    return None if known_of_one and not moved else moved


COLOUR_SPACES = "tex_colorspace"
"""The colour space of each texture: 0 for those that the model makes itself."""

SCENE = (Part.LIGHTS, Part.THINGS, Part.COLOURS)


def _moved(
    left: Mapping[str, Sequence[float]], right: Mapping[str, Sequence[float]], names: Iterable[str] = ()
) -> bool | None:
    """Return whether any number differs that both have; None where both have none.

    A sum over more or fewer numbers is not compared: an array has another layout then. How many lights and things there
    are is a number of its own.
    """
    common = [name for name in left if name in right and (not names or name in names)]
    if not common:
        return None
    return any(_differs(left[name], right[name]) for name in common)


def _differs(left: Sequence[float], right: Sequence[float]) -> bool:
    is_sum = len(left) == len(right) == 2
    if len(left) != len(right) or (is_sum and left[0] != right[0]):
        return False
    pairs, most = zip(left, right, strict=True), SAME_SUM if is_sum else SAME_NUMBER
    return any(abs(a - b) > most * max(1.0, abs(a), abs(b)) for a, b in pairs)


# --- families --------------------------------------------------------------------------------------------------


def families(cells: Sequence[str], compare_cells: Callable[[str, str], PixelComparison]) -> dict[str, str]:
    """Return the letter of each cell: the same one for pictures that look the same.

    A prime marks a cell whose pictures look like those of the first cell of its family and are not equal to the bit; a
    question mark marks one whose pictures cannot be compared, or do not repeat.
    """
    members: list[list[str]] = []
    letters: dict[str, str] = {}
    for cell in cells:
        relations = [[compare_cells(one, cell) for one in family] for family in members]
        fitting = next(
            (number for number, family in enumerate(relations) if all(one.looks_same for one in family)), None
        )
        if fitting is None and any(one.kind in UNTOLD for family in relations for one in family):
            letters[cell] = "?"
            continue
        if fitting is None:
            members.append([])
            fitting = len(members) - 1
            relations.append([])
        prime = "'" if relations[fitting] and relations[fitting][0].kind is not Look.IDENTICAL else ""
        members[fitting].append(cell)
        round_, place = divmod(fitting, len(ascii_lowercase))
        letters[cell] = ascii_lowercase[place] + (str(round_) if round_ else "") + prime
    return letters


UNTOLD = frozenset({Look.NOT_COMPARABLE, Look.NONDETERMINISTIC})
"""Relations of pictures that say nothing of how they look."""

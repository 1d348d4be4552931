"""Define the facts that checks record for later judging: pictures in numbers, camera poses, values of a trajectory.

Also the top-level modules that were loaded when a picture was drawn. These facts are in the reply, under the names in
`RECORDED`. Records and documents leave them out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType

from harness.model import decoding
from harness.model.hostile_data import Unreadable, raise_unreadable

MOST_NUMBERS = 1_000
"""floats of a trajectory: as many entries as hold them; `cell_trace.py` keeps to it."""

Size = Annotated[int, Meta(ge=0)]
Triple = tuple[float, float, float]
Matrix = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]
Part = Annotated[tuple[float | None, ...], Meta(max_length=64)]
Entry = Annotated[tuple[Part | None, ...], Meta(min_length=1, max_length=4)]


class Camera(Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The camera of a picture.

    MuJoCo: position and directions, and the field of view in degrees, or the height of an orthographic picture.
    PyBullet: the matrices of view and lens, column by column.
    """

    position: Triple | UnsetType = UNSET
    forward: Triple | UnsetType = UNSET
    up: Triple | UnsetType = UNSET
    fovy: float | UnsetType = UNSET
    height: float | UnsetType = UNSET
    view: Matrix | UnsetType = UNSET
    lens: Matrix | UnsetType = UNSET


class Picture(Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """A frame at its full size; `sha256` is of its pixels, for the rest see `incell/cell_pictures.py`."""

    shape: tuple[Size, Size, Size]
    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
    constant: bool
    colours: Annotated[dict[Annotated[str, Meta(pattern=r"^[0-3]{3}$")], Size], Meta(max_length=64)]
    means: Annotated[tuple[Triple | None, ...], Meta(min_length=9, max_length=9)]
    spread: Triple
    camera: Camera | None


class Values(Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The first entries of a trajectory: the observation of a reset; of a step also reward, terminated, truncated.

    There were `steps` entries, and `sizes` numbers in each of the four parts; what is missing was cut. A part that
    holds no numbers is None, and so is a number that is not finite.
    """

    steps: Size
    sizes: tuple[Size, Size, Size, Size]
    entries: Annotated[tuple[Entry, ...], Meta(max_length=MOST_NUMBERS)]


Modules = Annotated[tuple[Annotated[str, Meta(max_length=200)], ...], Meta(max_length=1_000)]

RECORDED: Mapping[str, Any] = {
    "loaded": Modules,
    "pictures": Annotated[dict[str, Picture], Meta(max_length=2)],
    "values": Values,
}
"""The type of each fact that is recorded for later judging."""


def drop_mistyped(facts: Mapping[str, Any]) -> tuple[Mapping[str, Any], str | None]:
    """Return the facts of a check without those of a wrong type, and the reason why some were left out, if any."""
    wrong: dict[str, str] = {}
    for name in sorted(RECORDED.keys() & facts.keys()):
        try:
            with raise_unreadable():
                _measure(decoding.convert(facts[name], RECORDED[name]))
        except Unreadable as error:
            wrong[name] = f"its fact {name} is left out: {error}"
    if not wrong:
        return facts, None
    return {name: fact for name, fact in facts.items() if name not in wrong}, "; ".join(wrong.values())


def plain(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts that records keep: all but those recorded for later judging, which stay in the reply."""
    return {name: fact for name, fact in facts.items() if name not in RECORDED}


def _measure(fact: object) -> None:
    """Raise ValueError where a trajectory has more numbers than a cell may record."""
    if isinstance(fact, Values) and sum(len(part or ()) for entry in fact.entries for part in entry) > MOST_NUMBERS:
        message = f"more than {MOST_NUMBERS} numbers"
        raise ValueError(message)

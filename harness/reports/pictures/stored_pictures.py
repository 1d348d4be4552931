"""Read the pictures that the probe runs of a case left, as values that can be compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from harness.model import CaseRecord, decoding
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.physics import pixels
from harness.physics.outputs import Array
from harness.physics.pixels import Drawing, Drawings
from harness.probes import array_files, thumbnails
from harness.probes.evidence import GIVEN, PICTURE, PIXELS, Reading
from harness.probes.facts import Picture, Values
from harness.probes.vault import MOST_FILE, Vault
from harness.reports.pictures.first_pictures import RENDER

LOOP = "single.loop"
FIRST = f"{RENDER}-first{PICTURE}"

START = 0
"""The number that stands for the start, where no state of a bank was drawn."""

Numbers = Mapping[str, list[float]]


class DrawnState(msgspec.Struct, frozen=True):
    """The facts of one drawn state; see `incell/check_behave_pixels.py`."""

    state: int
    shape: tuple[int, int, int]
    drawings: int
    camera: Mapping[str, float | list[float]] | None
    lights: Numbers = {}
    things: Numbers = {}
    colours: Numbers = {}
    flags: Numbers = {}


class DrawnFacts(msgspec.Struct, frozen=True):
    """The facts of all drawn states."""

    drawn: tuple[DrawnState, ...]
    unrepeated: tuple[int, ...]
    gl: Mapping[str, str]
    form: int
    textures: Numbers = {}
    settings: Numbers = {}


def of_states(case: CaseRecord, vault: Vault) -> Drawings | None:
    """Return what was drawn of the states of a bank; None where nothing was, or nothing can be read."""
    for run in reversed(case.runs):
        try:
            files = vault.files(run)
            if PIXELS in files and GIVEN in files:
                return read_states(array_files.decode(vault.content(files[PIXELS], MOST_FILE)), files[GIVEN])
        except Unreadable:
            continue
    return None


def read_states(arrays: Mapping[str, Array], subject: str) -> Drawings:
    """Return the drawings in a file of arrays. Raises Unreadable."""
    with raise_unreadable():
        facts = decoding.convert(array_files.facts(arrays), DrawnFacts)
        small, digests = arrays.get("small"), arrays.get("digest", np.zeros((0, 32), np.uint8))
        if small is not None and (*small.shape[:1], *small.shape[3:]) != (len(digests), 3):
            message = "its small pictures are not arrays of colours"
            raise Unreadable(message)
        by_state = {
            drawn.state: Drawing(
                shape=drawn.shape,
                digest=digest.tobytes().hex(),
                fields=None if small is None else small[number],
                parts={
                    "camera": _numbers(drawn.camera),
                    "lights": drawn.lights,
                    "things": drawn.things,
                    "colours": drawn.colours,
                    "flags": drawn.flags,
                },
            )
            for number, (drawn, digest) in enumerate(zip(facts.drawn, digests, strict=True))
        }
    return Drawings(
        subject=subject,
        by_state=by_state,
        unrepeated=frozenset(facts.unrepeated),
        parts={"textures": facts.textures, "settings": facts.settings},
        renderer=_renderer(facts.gl),
    )


def of_start(case: CaseRecord, vault: Vault) -> Drawings | None:
    """Return the first picture after a seeded reset, with the observation there as its subject."""
    picture = subject = None
    renderer = ""
    fields: Array | None = None
    for reading in vault.readings(case.runs):
        for check, facts in _facts(reading):
            if check == LOOP and subject is None:
                subject = _start(facts)
            if check == RENDER and "first" in facts.get("pictures", {}):
                picture, renderer = facts["pictures"]["first"], _renderer(facts.get("gl", {}))
                fields = _fields(reading, vault)
        if picture is not None and subject is not None:
            break
    if picture is None or subject is None:
        return None
    try:
        with raise_unreadable():
            drawn = decoding.convert(picture, Picture)
    except Unreadable:
        return None
    camera = msgspec.to_builtins(drawn.camera) if drawn.camera else None
    drawing = Drawing(shape=drawn.shape, digest=drawn.sha256, fields=fields, parts={"camera": _numbers(camera)})
    by_state = {START: drawing}
    return Drawings(subject=subject, by_state=by_state, unrepeated=frozenset(), parts={}, renderer=renderer)


def _facts(reading: Reading) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for check in reading.reply.checks:
        yield check.check, check.facts


def _start(facts: Mapping[str, Any]) -> Array | str | None:
    """Return the observation of the first reset, its digest where its numbers are not there."""
    try:
        with raise_unreadable():
            values = decoding.convert(facts["values"], Values).entries[0][0] if "values" in facts else None
            if values:
                return np.array([np.nan if number is None else number for number in values])
            return str(facts["trajectory"][0])
    except (Unreadable, LookupError, TypeError):
        return None


def _fields(reading: Reading, vault: Vault) -> Array | None:
    """Return the fields of the kept frame, None where it does not lie beside its report."""
    try:
        return pixels.fields(thumbnails.read(vault.content(reading.run.files[FIRST], MOST_FILE)))
    except (Unreadable, KeyError):
        return None


def _numbers(camera: Mapping[str, Any] | None) -> dict[str, list[float]]:
    """Return each property of a camera as a list."""
    return {name: list(np.ravel(value).tolist()) for name, value in (camera or {}).items()}


def _renderer(context: object) -> str:
    if not isinstance(context, Mapping):
        return ""
    return " ".join(str(context[part]) for part in ("renderer", "version") if part in context)

"""Known failures: the signatures that come with the harness, from `matrices/signatures/`.

`HARNESS_SIGNATURES` names another folder of them; set to the empty string, nothing is known.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from harness import signatures, verdict
from harness.errors import BadInput
from harness.evidence import Knowledge, causes, diagnosed
from harness.model import CellRecord
from harness.signatures import Signature

VARIABLE = "HARNESS_SIGNATURES"
FOLDER = "signatures"
HEAD, TAIL = 16_000, 48_000
"""Characters of a kept text that are looked at; of a longer one its middle is left out."""
KEPT = (".log", ".txt", ".jsonl")


def folder() -> Path | None:
    """Where the signatures lie: beside the package in a checkout, inside it in a wheel; None for none at all."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    package = Path(__file__).parent
    places = (place / "matrices" / FOLDER for place in (package, package.parent))
    return next((place for place in places if place.is_dir()), None)


def known() -> tuple[Signature, ...]:
    """All signatures. Raises BadInput."""
    place = folder()
    return _read(place) if place else ()


def files() -> tuple[Path, ...]:
    """The files that they stand in."""
    place = folder()
    return tuple(sorted(place.glob("*.toml"))) if place else ()


@cache
def _read(place: Path) -> tuple[Signature, ...]:
    if not place.is_dir():
        message = f"{place}: is no folder; {VARIABLE} names the folder of the signatures"
        raise BadInput(message)
    return signatures.read({path.name: _text(path) for path in sorted(place.glob("*.toml"))})


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        message = f"{path}: cannot be read: {error}"
        raise BadInput(message) from None


def beside(state: Path) -> Knowledge:
    """What failures are compared with, their logs lying below the state folder."""
    return Knowledge(signatures=known, logs=lambda path: texts(state / path))


def fitting(record: CellRecord, state: Path) -> tuple[str, ...]:
    """The known failures that count in a cell, by id; none where it is not expected to be one of them."""
    if record.cell.expect is None or record.cell.expect.signature is None:
        return ()
    found = diagnosed(record, verdict.judge(record), beside(state))
    return causes({one.signature.id: one.signature.masks for one in found})


def texts(place: Path) -> dict[str, str]:
    """The texts of a log file, or of a folder of evidence, by name; none where it is gone."""
    files = sorted(place.iterdir()) if place.is_dir() else [place]
    return {path.name: _bounded(path) for path in files if path.suffix in KEPT and path.is_file()}


def _bounded(path: Path) -> str:
    text = path.read_text(encoding="utf-8", errors="replace")
    return text if len(text) <= HEAD + TAIL else f"{text[:HEAD]}\n...\n{text[-TAIL:]}"

"""Known failures: the signatures that come with the harness, from `matrices/signatures/`.

`HARNESS_SIGNATURES` names another folder of them; set to the empty string, nothing is known.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from harness import signatures
from harness.errors import BadInput
from harness.signatures import Signature

VARIABLE = "HARNESS_SIGNATURES"
FOLDER = "signatures"


def folder() -> Path | None:
    """Where the signatures lie: beside the package in a checkout, inside it in a wheel; None for none at all."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    package = Path(__file__).parent
    inside = package / "matrices" / FOLDER
    return inside if inside.is_dir() else package.parent / "matrices" / FOLDER


def known() -> tuple[Signature, ...]:
    """All signatures. Raises BadInput."""
    place = folder()
    return _read(place) if place else ()


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

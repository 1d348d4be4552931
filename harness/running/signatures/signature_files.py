"""Find the folder of the known issues: `matrices/signatures/`, or the folder that `HARNESS_SIGNATURES` names."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "HARNESS_SIGNATURES"
FOLDER = "signatures"


def folder() -> Path | None:
    """Return the folder, beside the package in a checkout, inside it in a wheel; None where there is none."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    package = Path(__file__).parents[2]
    places = (place / "matrices" / FOLDER for place in (package, package.parent))
    return next((place for place in places if place.is_dir()), None)


def files() -> tuple[Path, ...]:
    """Return the files of the known issues."""
    place = folder()
    return tuple(sorted(place.glob("*.toml"))) if place else ()

"""Recipes that repair the fakes that no resolver accepts."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

WHEELS = {
    "fake-metadata-invalid": "146e37e50a17124e7d2b22efebf2b268d9b13f16bc381ef2cbd4fc035af37cfe",
    "fake-too-narrow": "699648ac8178303f53905c602866deff75a137539e8b5f90f5d5a76e01e4a0e7",
}
"""The repaired wheels; they are the same on every machine, unlike the sdists, which zlib has a say in."""

EDITS = {
    "fake-metadata-invalid": 'from = "fake-plain (>=3.)"\nto = "fake-plain (>=3)"\n',
    "fake-too-narrow": 'field = "Requires-Python"\nfrom = ">=3.99"\nto = ">=3.9"\n',
}
UPLOADED = "2021-10-06T22:04:25Z"


def recipe(name: str, shelf: Path, wheel: str | None = None) -> str:
    """The text of a recipe for a fake whose sdist lies on a shelf; `wheel` is the SHA-256 that it promises."""
    sdist = shelf / f"{name.replace('-', '_')}-1.0.tar.gz"
    return (
        f'package = "{name}"\nreason = "it was made so"\nlink = ""\nbuild = []\npython = ">=3.9"\n'
        f"[[edits]]\n{EDITS[name]}"
        f'[[releases]]\nversion = "1.0"\nuploaded = {UPLOADED}\n'
        f'sdist = "{sha256(sdist.read_bytes()).hexdigest()}"\nwheel = "{wheel or WHEELS[name]}"\n'
    )


def write(folder: Path, shelf: Path) -> None:
    """Put the recipes of all fakes that have one into `overlays/` below a folder."""
    overlays = folder / "overlays"
    overlays.mkdir(parents=True)
    for name in WHEELS:
        (overlays / f"{name}.toml").write_text(recipe(name, shelf), encoding="utf-8")

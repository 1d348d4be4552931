"""Recipes that repair the fakes that no resolver accepts: two sdists, and a wheel."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

WHEELS = {
    "fake-metadata-invalid": "146e37e50a17124e7d2b22efebf2b268d9b13f16bc381ef2cbd4fc035af37cfe",
    "fake-too-narrow": "699648ac8178303f53905c602866deff75a137539e8b5f90f5d5a76e01e4a0e7",
    "fake-new-python": "385aca8f02ca54ae4c6231607150bb6f1b7a47bfe2a5cf31410e2ec11a7d717f",
}
"""The repaired wheels; they are the same on every machine, unlike the sdists, which zlib has a say in."""

EDITS = {
    "fake-metadata-invalid": 'from = "fake-plain (>=3.)"\nto = "fake-plain (>=3)"\n',
    "fake-too-narrow": 'field = "Requires-Python"\nfrom = ">=3.99"\nto = ">=3.9"\n',
    "fake-new-python": 'field = "Requires-Python"\nfrom = ">=3.99"\nto = ">=3.9"\n',
}
UPLOADED = "2021-10-06T22:04:25Z"


def recipe(name: str, shelf: Path, wheel: str | None = None) -> str:
    """The text of a recipe for a fake that lies on a shelf; `wheel` is the SHA-256 that it promises."""
    (file,) = shelf.glob(f"{name.replace('-', '_')}-1.0*")
    build, key = ("", "wheel_from") if file.suffix == ".whl" else ('build = []\npython = ">=3.9"\n', "sdist")
    return (
        f'package = "{name}"\nreason = "it was made so"\nlink = ""\n{build}'
        f"[[edits]]\n{EDITS[name]}"
        f'[[releases]]\nversion = "1.0"\nuploaded = {UPLOADED}\n'
        f'{key} = "{sha256(file.read_bytes()).hexdigest()}"\nwheel = "{wheel or WHEELS[name]}"\n'
    )


def write(folder: Path, shelf: Path) -> None:
    """Put the recipes of all fakes that have one into `overlays/` below a folder."""
    overlays = folder / "overlays"
    overlays.mkdir(parents=True)
    for name in WHEELS:
        (overlays / f"{name}.toml").write_text(recipe(name, shelf), encoding="utf-8")

"""Look up what the changelog of a package says of a change in behaviour: `matrices/changelogs/PACKAGE.toml`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import msgspec

from harness.machine.files import given_files
from harness.model.schema import load_toml
from harness.running import open_matrix

FOLDER = "changelogs"


class ReleaseNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The entries of one release that may change how a simulation behaves; empty where it was read and has none."""

    version: str
    says: str


class Changelog(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The releases of a package whose changelog was read, and where it is."""

    source: str
    release: tuple[ReleaseNote, ...] = ()


def look_up(package: str, releases: Sequence[str]) -> str:
    """Return what the changelog says of each release, or that it says nothing, or was not read."""
    log = _changelog(package)
    if log is None:
        return f"The changelog of {package} was not read."
    notes = {note.version: note.says for note in log.release}
    versions = (release.rpartition("-")[2] for release in releases)  # `gym-0.26.2` where an axis has several packages
    return " ".join(_sentence(version, notes.get(version)) for version in versions)


def _sentence(release: str, says: str | None) -> str:
    if says is None:
        return f"The changelog of {release} was not read."
    return f"The changelog of {release} says: {says}" if says else f"Not in the changelog of {release}."


@cache
def _changelog(package: str) -> Changelog | None:
    path = open_matrix.data_folder() / FOLDER / f"{package}.toml"
    if not path.is_file():
        return None
    return load_toml(given_files.read_text(path), Changelog, str(path))

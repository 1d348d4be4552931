"""Look up what the changelog of a package says of a change in behaviour: `matrices/changelogs/PACKAGE.toml`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import msgspec
from packaging.version import Version

from harness.machine.files import given_files
from harness.model.schema import load_toml
from harness.running import open_matrix

FOLDER = "changelogs"
NOT_THERE = "In no changelog."


class ReleaseNote(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The entries of one release that may change how a simulation behaves, in the words of the changelog."""

    version: str
    says: str


class Changelog(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A changelog as far as it was read: where it is, up to which release, and what it says."""

    source: str
    read_until: str
    release: tuple[ReleaseNote, ...] = ()


def look_up(package: str, releases: Sequence[str]) -> str:
    """Return what the changelog says of these releases, or that it says nothing; empty if it was not read."""
    log = _changelog(package)
    if log is None:
        return ""
    notes = [f"The changelog of {one.version} says: {one.says}" for one in log.release if one.version in releases]
    if any(Version(release) > Version(log.read_until) for release in releases):
        notes.append(f"The changelog was read up to {log.read_until}.")
    return " ".join(notes) or NOT_THERE


@cache
def _changelog(package: str) -> Changelog | None:
    path = open_matrix.data_folder() / FOLDER / f"{package}.toml"
    if not path.is_file():
        return None
    return load_toml(given_files.read_text(path), Changelog, str(path))

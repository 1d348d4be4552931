"""Look up what the changelog of a package says of a change in behaviour: `matrices/changelogs/PACKAGE.toml`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache

import msgspec

from harness.machine.files import given_files
from harness.model.schema import load_toml
from harness.physics.families import release_order
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


def look_up_moved(axis: str, releases: Sequence[str], moved: Mapping[str, tuple[str | None, str | None]]) -> str:
    """Return what the changelogs say of the releases of an axis, and of other packages that moved with it."""
    package = release_order(releases[-1])[0] or axis
    besides = [
        look_up(name, (f"{name} {new}",))
        for name, (_, new) in moved.items()
        if name != package and new and _changelog(name)
    ]
    own = [] if besides and _changelog(package) is None else [look_up(package, releases)]
    return " ".join([*own, *besides])


def look_up(package: str, releases: Sequence[str]) -> str:
    """Return what the changelog says of each release, or that it says nothing, or was not read.

    A release is a version, or has its package before it: `gym-0.26.2`, `mujoco 3.0.0`.
    """
    log = _changelog(package)
    if log is None:
        return f"The changelog of {package} was not read."
    notes = {note.version: note.says for note in log.release}
    versions = [re.split(r"[- ]", release)[-1] for release in releases]
    return " ".join(_sentence(release, notes.get(version)) for release, version in zip(releases, versions, strict=True))


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

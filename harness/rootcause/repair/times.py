"""Look up releases as of a time: when a cell's pins were uploaded, and what it could install."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timedelta
from functools import cache

from packaging.specifiers import SpecifierSet
from packaging.utils import InvalidWheelFilename, parse_wheel_filename
from packaging.version import Version

from harness.model import Cell, IndexSettings, Interpreter
from harness.model.errors import HarnessError
from harness.packages import index, locks
from harness.packages.index import Release
from harness.rootcause.repair import candidate_changes

AFTER_DAYS = (0, 7, 30)
"""A release often needs another that was uploaded some days later."""

PYTHONS = {
    "3.7": "2018-06-27", "3.8": "2019-10-14", "3.9": "2020-10-05", "3.10": "2021-10-04", "3.11": "2022-10-24",
    "3.12": "2023-10-02", "3.13": "2024-10-07", "3.14": "2025-10-07",
}  # fmt: skip
"""When each Python came out (peps.python.org, the release schedules)."""

WHEELS_DAYS = 90
"""By then most packages have wheels for a new Python."""


def releases(name: str, settings: IndexSettings, cutoff: str | None, *, offline: bool) -> tuple[Release, ...]:
    """Return the releases of a package uploaded by `cutoff`, oldest first; none if the index does not tell."""
    listing = _listed(name, settings, offline=offline)
    # Find-links places tell no times; as in uv no cutoff applies to their files.
    return tuple(one for one in listing if cutoff is None or one.uploaded is None or one.uploaded <= cutoff)


@cache
def _listed(name: str, settings: IndexSettings, *, offline: bool) -> tuple[Release, ...]:
    try:
        return index.releases(name, settings, offline=offline)
    except HarnessError:
        return ()


def instants(cell: Cell, installed: dict[str, str], minor: str, *, offline: bool) -> tuple[str, ...]:
    """Return the times worth a try: when the newest release that the cell pins was uploaded, and a little later.

    If it pins nothing, the installed releases of what it requires count. No time is before there were wheels for this
    Python, nor as late as the one that the cell asks for already.
    """
    pinned = candidate_changes.pins(cell) or {
        name: installed[name] for name in candidate_changes.asked_for(cell) if name in installed
    }
    uploads = [at for name, version in pinned.items() if (at := upload_time(cell, name, version, offline=offline))]
    if not uploads:
        return ()
    newest = datetime.fromisoformat(max(uploads))
    # `uploaded` is the time of the first file only; the end of the day leaves time for the other wheels.
    moments = [newest.replace(hour=23, minute=59, second=59) + timedelta(days=days) for days in AFTER_DAYS]
    if minor in PYTHONS:
        wheels = datetime.fromisoformat(f"{PYTHONS[minor]}T23:59:59+00:00") + timedelta(days=WHEELS_DAYS)
        moments = [max(one, wheels) for one in moments]
    texts = dict.fromkeys(one.strftime("%Y-%m-%dT%H:%M:%SZ") for one in moments)
    return tuple(text for text in texts if cell.question.snapshot is None or text < cell.question.snapshot)


def upload_time(cell: Cell, name: str, version: str, *, offline: bool) -> str | None:
    """Return the upload time of a release; None if it is unknown."""
    for release in releases(name, cell.question.index, None, offline=offline):
        if Version(release.version) == Version(version):
            return release.uploaded
    return None


def usable(
    cell: Cell, name: str, interpreter: Interpreter | None, *, wheels: bool, offline: bool
) -> tuple[Version, ...]:
    """Return the releases of a package that a cell may use: not yanked, no pre-releases, with a file for its Python.

    `wheels` leaves out releases that would have to be built.
    """
    listing = releases(name, cell.question.index, cell.question.snapshot, offline=offline)
    versions = [(Version(one.version), one) for one in listing if not one.yanked]
    return tuple(
        version
        for version, one in versions
        if not version.is_prerelease and ((one.sdist and not wheels) or has_wheel(one.wheels, interpreter))
    )


def has_wheel(files: Iterable[str], interpreter: Interpreter | None, *, native: bool = False) -> bool:
    """Return whether a wheel is for this Python, any if it is None; a `native` one is for few platforms."""
    supported = None if interpreter is None else locks.tags(interpreter)
    for file in files:
        try:
            tags = parse_wheel_filename(file)[3]
        except InvalidWheelFilename:
            continue
        if any((supported is None or tag in supported) and not (native and tag.platform == "any") for tag in tags):
            return True
    return False


def newest(
    cell: Cell, name: str, instant: str | None, *, offline: bool, within: SpecifierSet | None = None
) -> str | None:
    """Return the newest release of a package at a time, within bounds; None if there is none."""
    listing = releases(name, cell.question.index, instant, offline=offline)
    versions = [Version(one.version) for one in listing if not one.yanked and (within is None or one.version in within)]
    return str(max((each for each in versions if not each.is_prerelease), default="")) or None

"""Choose releases of a range as values of an axis: those that install without a build on the Python of the cells."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import InvalidWheelFilename, parse_wheel_filename
from packaging.version import InvalidVersion, Version

from harness.ci.drafts.draft import Range
from harness.matrix.matrix_types import RangeTable
from harness.matrix.version_ranges import expand_range
from harness.model import Interpreter, replace
from harness.packages import locks
from harness.packages.index import Release

MOST_LEFT_OUT = 12
"""Releases that a range leaves out one by one; beyond that the matrix would be hard to read."""


def narrow(wanted: Range, offers: Sequence[Release], python: str) -> Range:
    """Return the range without releases that cannot be installed on a Python (`3.11`), with a note that names them.

    A release needs a wheel for that Python, unless no release of the range has any wheel.
    """
    allowed = [offer for offer in offers if _allows(wanted.range, offer.version) and not offer.yanked]
    built = any(offer.wheels for offer in allowed)
    # Tags depend on the implementation and the minor version alone, so the rest of this interpreter can be made up.
    tags = frozenset(locks.tags(Interpreter(path="", version=f"{python}.0", implementation="cpython", identity="")))
    usable = {offer.version for offer in allowed if _fits(offer, python, tags, built=built)}
    before = _values(wanted, allowed)
    if not usable:
        return replace(wanted, note=f"No release that the project allows installs without a build on Python {python}.")
    oldest, newest = min(usable, key=Version), max(usable, key=Version)
    others = [Version(offer.version) for offer in allowed if offer.version not in usable]
    gaps = [str(version) for version in others if Version(oldest) < version < Version(newest)]
    lower = [f">={oldest}"] if any(Version(version) < Version(oldest) for version in before) else []
    upper = [f"<={newest}"] if any(version > Version(newest) for version in others) else []
    parts = [*_specifiers(wanted.range, lower), *upper, *(f"!={version}" for version in gaps[:MOST_LEFT_OUT])]
    new_range = replace(wanted, range=",".join(parts) or ">=0")
    gone = [version for version in before if version not in _values(new_range, allowed)]
    if not gone:
        return wanted
    return replace(new_range, note=f"Left out, not installable without a build on Python {python}: {', '.join(gone)}.")


def exclude(wanted: Range, versions: Sequence[str]) -> Range:
    """Return a range without some versions, with a note on why they are left out."""
    if not versions:
        return wanted
    note = f"Left out, not installable with the newest release of the other axes: {', '.join(versions)}."
    return replace(
        wanted,
        range=",".join([wanted.range, *(f"!={version}" for version in versions)]),
        note=" ".join(filter(None, [wanted.note, note])),
    )


def _specifiers(text: str, lower: list[str]) -> list[str]:
    """Return the parts of a specifier, its lower bound replaced where there is another."""
    parts = [part for part in text.split(",") if part and part != ">=0"]
    return [*(part for part in parts if not (lower and part.startswith(">"))), *lower]


def _allows(text: str, version: str) -> bool:
    try:
        return SpecifierSet(text).contains(Version(version))
    except (InvalidSpecifier, InvalidVersion):
        return False


def _values(wanted: Range, offers: Iterable[Release]) -> tuple[str, ...]:
    """Return the versions to which the range expands."""
    table = RangeTable(range=wanted.range, rule=wanted.rule)
    return expand_range(table, [(offer.version, offer.yanked) for offer in offers])


def _fits(offer: Release, python: str, tags: frozenset[object], *, built: bool) -> bool:
    try:
        pythons = SpecifierSet(offer.requires_python or "")
    except InvalidSpecifier:
        pythons = SpecifierSet()
    if not any(pythons.contains(f"{python}.{patch}") for patch in (0, 99)):
        return False
    return not built or any(_is_for(name, tags) for name in offer.wheels)


def _is_for(wheel: str, tags: frozenset[object]) -> bool:
    try:
        return bool(parse_wheel_filename(wheel)[3] & tags)
    except InvalidWheelFilename:
        return False

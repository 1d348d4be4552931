"""Describe packages that were never measured together: the results of each part, and what to try."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.model import replace
from harness.reports.answers.measured_cells import CellResult, Query, find_fitting, find_good
from harness.reports.answers.recommending import Combination, combinations, newest, public_version


class Half(msgspec.Struct, frozen=True, kw_only=True):
    """One part of the packages with its newest good combination; None if none works.

    `installed` are releases that were only in locks: they were never run.
    """

    packages: tuple[str, ...]
    combination: Combination | None
    installed: tuple[str, ...] = ()


class Apart(msgspec.Struct, frozen=True, kw_only=True):
    """Packages that were never measured together: the results of each part, and the requirements for `try`."""

    halves: tuple[Half, ...]
    requirements: tuple[str, ...]
    python: str | None


def find_apart(cells: Sequence[CellResult], query: Query) -> Apart | None:
    """Return the results of packages that no cell combines; None if some cell does, whatever its versions."""
    free = tuple(replace(one, versions=SpecifierSet()) for one in query.wanted)
    # A red measurement counts, also one that could not be locked: the packages were tried together.
    fits = find_fitting(cells, Query(wanted=free))
    if len(query.wanted) < 2 or any(one.cell.lock is None or {*query.names} <= one.about for one in fits):
        return None
    names = _largest(cells, query)
    groups = [names, *((name,) for name in query.names if name not in names)]
    python = query.python or _common_python(cells, query)
    halves = tuple(_half(cells, replace(query, python=python, env=None, needs=()), group) for group in groups)
    return Apart(halves=halves, requirements=tuple(_requirements(query, halves)), python=python)


def installed_releases(cells: Sequence[CellResult], name: str) -> tuple[str, ...]:
    """Return the releases of a package that were in locks of working cells and that no case ran, newest first."""
    releases = {one.pins[name] for one in cells if one.works and name in one.pins and name not in one.exercised}
    return tuple(sorted(releases, key=Version, reverse=True))


def _largest(cells: Sequence[CellResult], query: Query) -> tuple[str, ...]:
    """Return the largest group of packages for which some cell is good, preferring those named first."""
    for count in range(len(query.names) - 1, 1, -1):
        for wanted in itertools.combinations(query.wanted, count):
            if newest(cells, Query(wanted=wanted)):
                return tuple(one.name for one in wanted)
    return query.names[:1]


def _common_python(cells: Sequence[CellResult], query: Query) -> str | None:
    """Return the newest Python on which each of the packages has a good cell, or None."""
    pythons = [{one.minor for one in find_good(cells, Query(wanted=(wanted,)))} for wanted in query.wanted]
    common = set.intersection(*filter(None, pythons)) if any(pythons) else set()
    return max(common, key=Version, default=None)


def _half(cells: Sequence[CellResult], query: Query, names: Sequence[str]) -> Half:
    wanted = tuple(one for one in query.wanted if one.name in names)
    matches = combinations(cells, replace(query, wanted=wanted), limit=1)
    matches = matches or combinations(cells, Query(wanted=wanted), limit=1)
    beside = () if matches or len(names) > 1 else installed_releases(cells, names[0])
    return Half(packages=tuple(names), combination=matches[0] if matches else None, installed=beside)


def _requirements(query: Query, halves: Sequence[Half]) -> list[str]:
    """Return the requirements to try, with the measured version where none was asked for."""
    versions = {
        name: version for half in halves if half.combination for name, version in half.combination.versions.items()
    }
    return [
        one.text if one.versions or one.name not in versions else f"{one.text}=={public_version(versions[one.name])}"
        for one in query.wanted
    ]

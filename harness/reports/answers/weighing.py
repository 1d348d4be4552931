"""Weigh a combination: how many tasks and Pythons it was measured with, and how it behaves next to its neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec
from packaging.version import Version

from harness.reports.answers.measured_cells import CellResult
from harness.reports.answers.recommending import Combination, newness

MORE_TASKS = 2
"""So many times the tasks make another combination worth a word."""


class Neighbour(msgspec.Struct, frozen=True, kw_only=True):
    """A release of a package against the one measured before it: `same` of `tasks` behave alike.

    `cell` is where it was measured, with the versions of `beside`, all else equal for both releases.
    """

    package: str
    version: str
    before: str
    same: int
    tasks: int
    beside: dict[str, str]
    cell: str


class Thorough(msgspec.Struct, frozen=True, kw_only=True):
    """A combination that was measured with many more tasks than the first one."""

    versions: dict[str, str]
    tasks: int
    pythons: tuple[str, ...]


class Weighed(msgspec.Struct, frozen=True, kw_only=True):
    """What was weighed for the first of so many combinations that work; `newest` is whether none of them is newer.

    `tasks` is the number of environments run with it.
    """

    works: int
    newest: bool
    tasks: int
    pythons: tuple[str, ...]
    behaves: tuple[Neighbour, ...]
    thorough: Thorough | None


def weigh(cells: Sequence[CellResult], found: Sequence[Combination]) -> Weighed | None:
    """Return what was weighed for the first of these combinations; None if there is none."""
    if not found:
        return None
    first = found[0]
    return Weighed(
        works=len(found),
        newest=newness(first.versions.values()) == max(newness(one.versions.values()) for one in found),
        tasks=len(first.environments),
        pythons=minors(first.pythons),
        behaves=tuple(_neighbours(cells, first.versions)),
        thorough=_thorough(found),
    )


def minors(pythons: Iterable[str]) -> tuple[str, ...]:
    """Return the minor versions of Pythons, newest first."""
    names = {".".join(python.split(".")[:2]) for python in pythons}
    return tuple(sorted(names, key=Version, reverse=True))


def _thorough(found: Sequence[Combination]) -> Thorough | None:
    """Return the combination with the most tasks if it has many more than the first one."""
    most = max(found, key=lambda one: len(one.environments))
    if len(most.environments) < MORE_TASKS * max(len(found[0].environments), 1):
        return None
    return Thorough(versions=most.versions, tasks=len(most.environments), pythons=minors(most.pythons))


def _neighbours(cells: Sequence[CellResult], versions: Mapping[str, str]) -> Iterator[Neighbour]:
    """Yield, for each package whose release was compared with the one before it, the comparison with most tasks."""
    behaving = {one.cell.id: one for one in cells if any(case.behaviour for case in one.cell.cases)}
    for package, version in versions.items():
        fitting = [
            found
            for one in behaving.values()
            if package in one.cell.axes and one.version(package) == version
            for found in _compare(one, behaving, package)
        ]
        if fitting:
            yield max(fitting, key=lambda each: (_alike(each.beside, versions), each.tasks))


def _alike(beside: Mapping[str, str], versions: Mapping[str, str]) -> int:
    return sum(versions.get(name) == version for name, version in beside.items())


def _compare(result: CellResult, cells: Mapping[str, CellResult], package: str) -> Iterator[Neighbour]:
    """Yield the comparison of a cell with each cell before it that differs in the release of one package."""
    same: dict[str, list[bool]] = {}
    for case in result.cell.cases:
        entry = case.behaviour or None
        before = cells.get(entry.reference or "") if entry else None
        if entry and before:
            other = next((each.behaviour for each in before.cell.cases if each.case == case.case and each.behaviour), None)
            if other:
                same.setdefault(before.cell.id, []).append(_agree(entry.family, other.family))
    for name, tasks in same.items():
        moved = {axis for axis, value in result.cell.axes.items() if cells[name].cell.axes.get(axis) != value}
        if moved == {package}:
            yield Neighbour(
                package=package,
                version=str(result.version(package)),
                before=str(cells[name].version(package)),
                same=sum(tasks),
                tasks=len(tasks),
                beside={each: version for each, version in result.chosen.items() if each != package},
                cell=result.cell.id,
            )


def _agree(one: str, other: str) -> bool:
    """Return whether two cells share a family; what cannot be decided (`?`) counts as a difference."""
    return bool({*one.replace("'", "")} & {*other.replace("'", "")} - {"?"}) and "?" not in one + other

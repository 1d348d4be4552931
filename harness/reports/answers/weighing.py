"""Weigh a combination: how many tasks and Pythons it was measured with, and how it behaves next to its neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec
from packaging.version import Version

from harness.model import CASE_PHASES, Outcome
from harness.reports.answers.measured_cells import CellResult, Query, names_env
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
    """The facts that were weighed for the first of so many combinations that work.

    `newer` are the versions of a newer one, and `why` says what keeps it from being the first. `tasks` is the number of
    environments run with the first, and `passed` are the phases that all of them passed; if one is asked for, it alone
    counts.
    """

    works: int
    newer: dict[str, str]
    why: str
    tasks: int
    passed: tuple[str, ...]
    pythons: tuple[str, ...]
    behaves: tuple[Neighbour, ...]
    thorough: Thorough | None


def weigh(cells: Sequence[CellResult], candidates: Sequence[Combination], query: Query) -> Weighed | None:
    """Return what was weighed for the first of these combinations; None if there is none."""
    if not candidates:
        return None
    first, newest = candidates[0], max(candidates, key=lambda one: newness(one.versions.values()))
    return Weighed(
        works=len(candidates),
        newer=newest.versions if newest.versions != first.versions else {},
        why=_why(newest) if newest.versions != first.versions else "",
        tasks=1 if query.env else len(first.environments),
        passed=_passed(cells, first, query),
        pythons=minors(first.pythons),
        behaves=tuple(_neighbours(cells, first.versions)),
        thorough=_thorough(candidates, query),
    )


def _passed(cells: Iterable[CellResult], first: Combination, query: Query) -> tuple[str, ...]:
    """Return the phases that passed in the environment asked for, or in all of the cell."""
    cell = next(one.cell for one in cells if (one.cell.id, one.cell.machine) == (first.cell, first.machine))
    phases_of_env = [case.phases for case in cell.cases if query.env and names_env(case, query.env)]
    return tuple(
        str(phase)
        for phase in CASE_PHASES
        if all(phases.get(phase) is Outcome.PASSED for phases in phases_of_env or [first.phases])
    )


def _why(newest: Combination) -> str:
    """Return what keeps a combination from being the first, though it is the newest."""
    if newest.repaired:
        return f"needs {', '.join(newest.repaired)} as a patched wheel"
    return f"needs {', '.join(newest.brought)}, which no index has"


def minors(pythons: Iterable[str]) -> tuple[str, ...]:
    """Return the minor versions of Pythons, newest first."""
    names = {".".join(python.split(".")[:2]) for python in pythons}
    return tuple(sorted(names, key=Version, reverse=True))


def _thorough(candidates: Sequence[Combination], query: Query) -> Thorough | None:
    """Return the combination with the most tasks if it has many more than the first one."""
    most = max(candidates, key=lambda one: len(one.environments))
    if query.env or len(most.environments) < MORE_TASKS * max(len(candidates[0].environments), 1):
        return None
    return Thorough(versions=most.versions, tasks=len(most.environments), pythons=minors(most.pythons))


def _neighbours(cells: Sequence[CellResult], versions: Mapping[str, str]) -> Iterator[Neighbour]:
    """Yield, for each package whose release was compared with the one before it, the comparison with most tasks."""
    behaving = {one.cell.id: one for one in cells if any(case.behaviour for case in one.cell.cases)}
    for package, version in versions.items():
        fitting = [
            neighbour
            for one in behaving.values()
            if package in one.cell.axes and one.version(package) == version
            for neighbour in _compare(one, behaving, package)
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
            other = next(
                (each.behaviour for each in before.cell.cases if each.case == case.case and each.behaviour), None
            )
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


def _agree(family: str, other: str) -> bool:
    """Return whether two cells share a family; what cannot be decided (`?`) counts as a difference."""
    return bool({*family.replace("'", "")} & {*other.replace("'", "")} - {"?"}) and "?" not in family + other

"""Find working cells that already have the versions that a remedy asks for.

A table may have ten thousand cells: each red cell looks its neighbours up by the values of its axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from harness.judging.known_failures import select_counting
from harness.model.report_types import CellEntry
from harness.model.vocabulary import parsed_requirement

Ranked = tuple[Version, str]
"""The version of the package that a remedy names first, and the label of the cell that has it."""


def find(group: Iterable[CellEntry], cells: Sequence[CellEntry]) -> tuple[str, str]:
    """Return the labels of two working cells that have the versions that the remedy of these asks for.

    The first differs from one of these cells only in that, the second in more. Each is empty if there is none.
    """
    alone: list[Ranked] = []
    together: list[Ranked] = []
    for wanted, red in _by_remedy(group):
        names = {str(canonicalize_name(one.name)) for one in wanted}
        axes = {axis for cell in red for axis in cell.axes}
        for index in _indexes(cells, wanted, red[0].machine, axes):
            for cell in red:
                alone += index.alone(cell, names)
                together += index.together(cell, names)
    return max(alone, default=(None, ""))[1], max(together, default=(None, ""))[1]


def _by_remedy(group: Iterable[CellEntry]) -> Iterator[tuple[list[Requirement], list[CellEntry]]]:
    """Yield the versions that a remedy asks for, with the cells of one machine that have it."""
    groups: dict[tuple[str | None, tuple[str, ...]], tuple[list[Requirement], list[CellEntry]]] = {}
    for cell in group:
        wanted = _wanted(next((one.remedy for one in select_counting(cell)), {}))
        if wanted:
            groups.setdefault((cell.machine, tuple(map(str, wanted))), (wanted, []))[1].append(cell)
    yield from groups.values()


def _indexes(
    cells: Iterable[CellEntry], wanted: Sequence[Requirement], machine: str | None, axes: set[str]
) -> list[_Index]:
    """Return the working cells that have all these versions, divided by the axes that are packages there."""
    parts: dict[frozenset[str], list[tuple[Ranked, CellEntry]]] = {}
    for cell in cells:
        if cell.base is not None or cell.machine != machine or not cell.good:
            continue
        installed = cell.installed or {}
        if all(_has(installed, one) for one in wanted):
            rank = _parsed(installed[canonicalize_name(wanted[0].name)]), cell.label
            parts.setdefault(frozenset(axes & installed.keys()), []).append((rank, cell))
    return [_Index(packages, held) for packages, held in parts.items()]


class _Index:
    """Working cells whose axes `packages` are packages, found by the values of any axes; the newest come first."""

    def __init__(self, packages: frozenset[str], cells: Iterable[tuple[Ranked, CellEntry]]) -> None:
        self._packages = packages
        self._cells = sorted(cells, key=lambda pair: pair[0], reverse=True)
        self._tables: dict[tuple[str, ...], dict[tuple[str | None, ...], list[tuple[Ranked, CellEntry]]]] = {}

    def alone(self, cell: CellEntry, names: set[str]) -> Iterator[Ranked]:
        """Yield the newest cell that differs from this one in the packages of the remedy only."""
        same = self._equal(cell, tuple(axis for axis in cell.axes if axis not in names))
        best = next((rank for rank, other in same if _differing(cell, other)), None)
        yield from [best] if best else []

    def together(self, cell: CellEntry, names: set[str]) -> Iterator[Ranked]:
        """Yield the newest cell that differs in other axes, too: another Python or package would be another reason."""
        free = cell.axes.keys() - names - {"python"} - self._packages - (cell.installed or {}).keys()
        if free:
            same = self._equal(cell, tuple(axis for axis in cell.axes if axis not in names | free))
            best = next((rank for rank, other in same if _differing(cell, other) - names), None)
            yield from [best] if best else []

    def _equal(self, cell: CellEntry, axes: tuple[str, ...]) -> list[tuple[Ranked, CellEntry]]:
        """Return the working cells that have the same values of these axes."""
        if axes not in self._tables:
            table: dict[tuple[str | None, ...], list[tuple[Ranked, CellEntry]]] = {}
            for rank, other in self._cells:
                table.setdefault(tuple(map(other.axes.get, axes)), []).append((rank, other))
            self._tables[axes] = table
        return self._tables[axes].get(tuple(map(cell.axes.get, axes)), [])


def _differing(cell: CellEntry, other: CellEntry) -> set[str]:
    """Return the axes of a cell in which another differs."""
    return {axis for axis in cell.axes if cell.axes[axis] != other.axes.get(axis)}


def _wanted(remedy: Mapping[str, Any]) -> list[Requirement]:
    """Return the requirements of a remedy; empty if it asks for anything but versions of packages."""
    if not {*remedy} <= {"text", "requirements", "constraints"}:
        return []
    try:
        return [*map(parsed_requirement, (*remedy.get("requirements", ()), *remedy.get("constraints", ())))]
    except ValueError:  # a report of others may hold anything
        return []


def _has(installed: Mapping[str, str], wanted: Requirement) -> bool:
    """Return whether a cell has a version that a requirement allows."""
    version = installed.get(canonicalize_name(wanted.name))
    # An installed pre-release counts: it is there, whatever a resolver would choose.
    return version is not None and wanted.specifier.contains(version, prereleases=True)


def _parsed(text: str) -> Version:
    try:
        return Version(text)
    except InvalidVersion:
        return Version("0")

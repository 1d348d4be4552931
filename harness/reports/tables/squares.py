"""Build the small table of a matrix: its main cells over two axes, with the tasks and Pythons tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations

from harness.model import CASE_PHASES, FAILING, Outcome, Phase, Role, Verdict
from harness.model.report_types import SEVERITY, UNTOLD, CaseEntry, CellEntry
from harness.reports.tables import cause_groups, change_effects
from harness.reports.tables.table_types import Pivot, Square

NOTHING = "-"
PASSING = frozenset({Outcome.PASSED, Outcome.SKIPPED, Outcome.UNAVAILABLE})
TRIED = CASE_PHASES[1:]
"""Phases in which an environment runs; to import a module is no task."""


# --- tasks -----------------------------------------------------------------------------------------------------


def was_tried(case: CaseEntry) -> bool:
    """Return whether an environment was tried: some phase passed after the import, or failed."""
    ended = {*case.phases.values()}
    ran = any(case.phases.get(phase) is Outcome.PASSED for phase in TRIED)
    return case.env is not None and (ran or bool(ended & FAILING))


def has_passed(case: CaseEntry) -> bool:
    """Return whether everything asked of an environment passed, as far as this machine can tell."""
    return was_tried(case) and {*case.phases.values()} <= PASSING and not case.misleads


def tasks(cells: Iterable[CellEntry]) -> tuple[int, int]:
    """Count the tasks that passed in all of the cells that tried them, and those that were tried."""
    ends: dict[str, bool] = {}
    for case in (case for cell in cells for case in cell.cases if was_tried(case)):
        ends[case.case] = ends.get(case.case, True) and has_passed(case)
    return sum(ends.values()), len(ends)


# --- the table -------------------------------------------------------------------------------------------------


def default_axes(axes: Sequence[str], cells: Sequence[CellEntry]) -> tuple[str, str] | None:
    """Choose the first two axes that vary: Python last, the one with more values down; None if nothing varies."""
    values = {axis: {cell.axes.get(axis) for cell in cells} for axis in axes}
    varying = [axis for axis in axes if len(values[axis]) > 1]
    if len(axes) < 2 or not varying:
        return None
    if len(varying) > 2 and "python" in varying:
        varying.remove("python")
    first = varying[0]
    second = (varying[1:] or [axis for axis in axes if axis != first])[0]
    # A table grows downwards, because a page and a terminal end at the right.
    return (second, first) if len(values[second]) > len(values[first]) else (first, second)


def pivot(cells: Sequence[CellEntry], axes: tuple[str, str], machines: Sequence[str]) -> Pivot:
    """Sort the main cells of a matrix into squares; `cells` are all cells of the matrix."""
    down, across = axes
    # A cell that never ran leaves its square empty.
    shown = [cell for cell in cells if cell.role is Role.MAIN and cell.measured]
    rows, columns = (cause_groups.in_order(cell.axes.get(axis, NOTHING) for cell in shown) for axis in axes)
    met: dict[tuple[str, str], list[CellEntry]] = {}
    for cell in shown:
        met.setdefault(_place(cell, axes), []).append(cell)
    beside = _Beside(cells, axes)
    squares = tuple(
        tuple(
            tuple(part for machine in machines for part in _parts(met.get((row, column), ()), machine, beside))
            for column in columns
        )
        for row in rows
    )
    return Pivot(down=down, across=across, rows=rows, columns=columns, squares=squares)


def _place(cell: CellEntry, axes: tuple[str, str]) -> tuple[str, str]:
    return cell.axes.get(axes[0], NOTHING), cell.axes.get(axes[1], NOTHING)


class _Beside:
    """Variants and changed cells, by the main cell that they belong to on the same machine."""

    def __init__(self, cells: Iterable[CellEntry], axes: tuple[str, str]) -> None:
        self.axes = axes
        self.changed: dict[tuple[str | None, str | None], list[CellEntry]] = {}
        self.variants: dict[tuple[tuple[str, str], str, str | None], list[CellEntry]] = {}
        for cell in (one for one in cells if one.measured):
            if cell.base:
                self.changed.setdefault((cell.base, cell.machine), []).append(cell)
            elif cell.role is Role.VARIANT:
                self.variants.setdefault((_place(cell, axes), cell.requested_python, cell.machine), []).append(cell)

    def of(self, cell: CellEntry) -> list[CellEntry]:
        """Return the variants and the changed cells of a main cell."""
        return [*self.sides(cell), *self.changed.get((cell.id, cell.machine), ())]

    def sides(self, cell: CellEntry) -> list[CellEntry]:
        """Return the variants of a main cell, which are the same cell under side conditions."""
        return self.variants.get((_place(cell, self.axes), cell.requested_python, cell.machine), [])


def _parts(cells: Sequence[CellEntry], machine: str, beside: _Beside) -> list[Square]:
    """Return one entry per verdict, the worst first; verdicts that say nothing about the packages come last."""
    groups: dict[Verdict, list[CellEntry]] = {}
    for cell in cells:
        if (cell.machine or NOTHING) == machine:
            groups.setdefault(cell.verdict, []).append(cell)
    order = sorted(groups, key=lambda verdict: (verdict in UNTOLD, SEVERITY.index(verdict)))
    where = _differences([groups[verdict] for verdict in order], {*beside.axes, "python"})
    return [_entry(groups[verdict], machine, told, beside) for verdict, told in zip(order, where, strict=True)]


def _entry(cells: Sequence[CellEntry], machine: str, where: tuple[str, ...], beside: _Beside) -> Square:
    verdict = cells[0].verdict
    count, of = tasks(cells)
    works, red = verdict is Verdict.WORKS, verdict not in {*UNTOLD, Verdict.WORKS}
    phases = {cell.phase for cell in cells if cell.phase and red}
    return Square(
        machine=machine,
        verdict=verdict,
        passed=count,
        tried=of,
        pythons=cause_groups.in_order(_minor(cell) for cell in cells),
        where=where,
        phase=", ".join(phase for phase in Phase if phase in phases) if count == of and of else "",
        patched=any(cell.repairs for cell in cells),
        fixed=red and any(change_effects.works(one) for cell in cells for one in beside.of(cell)),
        varies=works
        and any(one.verdict not in {*UNTOLD, Verdict.WORKS} for cell in cells for one in beside.sides(cell)),
        uneven=len({frozenset(case.case for case in cell.cases if was_tried(case)) for cell in cells}) > 1,
        doubted=works and any(cell.doubts for cell in cells),
    )


def _minor(cell: CellEntry) -> str:
    """Return the Python that ran, such as `3.11`, else the Python asked for."""
    return ".".join(cell.python.split(".")[:2]) if cell.python else cell.requested_python


def _differences(groups: Sequence[Sequence[CellEntry]], shown_axes: set[str]) -> list[tuple[str, ...]]:
    """Return the axis values by which each group differs from the others; empty if only Python does."""
    if len(groups) < 2:
        return [() for _ in groups]
    values = [{axis: {cell.axes.get(axis, NOTHING) for cell in group} for axis in group[0].axes} for group in groups]
    axes = [axis for axis in values[0] if axis not in shown_axes]
    telling = [axis for axis in axes if _apart([one.get(axis, set()) for one in values])]
    if not telling and not _apart([one.get("python", set()) for one in values]):
        telling = [axis for axis in axes if len({frozenset(one.get(axis, set())) for one in values}) > 1]
    return [
        tuple(f"{axis} {', '.join(cause_groups.in_order(one.get(axis, set())))}" for axis in telling) for one in values
    ]


def _apart(values: Sequence[set[str]]) -> bool:
    """Return whether no two of these have a value in common."""
    return not any(one & other for one, other in combinations(values, 2))

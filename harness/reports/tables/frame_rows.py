"""Group the frames of a matrix by task: each distinct picture once, with the combinations that look so."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from harness.judging.known_failures import select_counting
from harness.model import Phase
from harness.model.report_types import CaseEntry, CellEntry
from harness.reports.tables import cause_groups
from harness.reports.tables.table_types import EVERY, Frame, FrameRow

Drawn = list[tuple[CellEntry, CaseEntry]]


def frame_rows(cells: Iterable[CellEntry], axes: Sequence[str]) -> tuple[FrameRow, ...]:
    """Return a row for each task that was drawn: those with a misleading picture first, then those of most pictures."""
    drawn: dict[tuple[str, str], Drawn] = {}
    for cell in cells:
        for case in (one for one in cell.cases if one.frames):
            drawn.setdefault((case.case, case.env or ""), []).append((cell, case))
    rows = [FrameRow(task=task, env=env, frames=_frames(held, axes)) for (task, env), held in drawn.items()]
    return tuple(sorted(rows, key=lambda row: (not any(one.misleads for one in row.frames), -len(row.frames))))


def _frames(drawn: Drawn, axes: Sequence[str]) -> tuple[Frame, ...]:
    """Return the distinct first frames of a task, those of older releases first."""
    groups: dict[tuple[str, tuple[str, ...]], Drawn] = {}
    for cell, case in drawn:
        groups.setdefault((case.frames[0], case.misleads), []).append((cell, case))
    planned = [cell for cell, _ in drawn if cell.base is None]
    by_age = sorted(groups.items(), key=_age([[cell for cell, _ in held] for held in groups.values()], axes))
    return tuple(
        Frame(
            path=path,
            where=_where([cell for cell, _ in held], planned, axes),
            misleads=", ".join(misleads),
            issue=_issue(held[0][0]) if misleads else "",
        )
        for (path, misleads), held in by_age
    )


def _age(groups: Sequence[Sequence[CellEntry]], axes: Sequence[str]) -> Callable[[tuple[object, Drawn]], list[int]]:
    """Return a sort key: the place of a frame on the axis that separates the frames best, then on the others."""
    held = {axis: [{cell.axes.get(axis, "") for cell in group} for group in groups] for axis in axes}
    overlap = {axis: sum(map(len, sets)) / len(set().union(*sets)) for axis, sets in held.items()}
    ordered = sorted(axes, key=lambda axis: (axis == "python", overlap[axis]))
    values = {
        axis: cause_groups.in_order(cell.axes.get(axis, "") for group in groups for cell in group) for axis in axes
    }

    def place(frame: tuple[object, Drawn]) -> list[int]:
        return [min(values[axis].index(cell.axes.get(axis, "")) for cell, _ in frame[1]) for axis in ordered]

    return place


def _where(group: Sequence[CellEntry], planned: Sequence[CellEntry], axes: Sequence[str]) -> str:
    """Return the releases with which a task looks so; of cells that a change made, the change."""
    mine = [cell for cell in group if cell.base is None]
    if not mine:
        steps = dict.fromkeys(step for cell in group if cell.change for step in cell.change.does)
        return f"with a change: {'; '.join(steps)}"
    words = cause_groups.telling_values(mine, planned, axes)
    return ", ".join(words) or (EVERY if len({cell.id for cell in planned}) > 1 else f"`{mine[0].label}`")


def _issue(cell: CellEntry) -> str:
    """Return the known issue of a picture that misleads: the one of rendering, else the deepest."""
    counting = select_counting(cell)
    return next(
        (one.signature for one in counting if one.phase is Phase.RENDER), counting[0].signature if counting else ""
    )

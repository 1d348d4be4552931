"""Distribute cells over xdist's workers by environment: one worker makes and warms it, and runs all its cells.

A scheduler of our own, since a mark reaches xdist's only as a change to node ids, which pytest 9.2 no longer takes;
so ids are the same with and without workers, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from xdist.scheduler import LoadGroupScheduling  # type: ignore[import-untyped]

from harness.machine import capacity
from harness.machine.store import digest
from harness.model import Cell, replace
from harness.model.errors import HarnessError
from harness.running.scheduler import Runner

Group = Callable[[Iterable[Cell]], Mapping[str, str]]


class ByEnvironment(LoadGroupScheduling):  # type: ignore[misc]  # xdist has no types
    """A scheduler that locks the collected cells, then hands them out by the environment that their lock becomes."""

    def __init__(self, config: pytest.Config, log: Any, cells: Iterable[Cell], group: Group) -> None:
        super().__init__(config, log)
        self.cells = {cell.id: cell for cell in cells}
        self.group = group
        self.groups: Mapping[str, str] = {}

    def schedule(self) -> None:
        """Begin, or go on after a worker was replaced."""
        if self.collection is None:
            collected = next(iter(self.registered_collections.values()))
            cell_ids = dict.fromkeys(cell_id for nodeid in collected if (cell_id := self.cell_of(nodeid)))
            self.groups = self.group(self.cells[cell] for cell in cell_ids)
        super().schedule()

    def cell_of(self, nodeid: str) -> str | None:
        """Return the cell id of an item, if any: of our items by place, of a user's function by its parameter."""
        place, _, name = nodeid.partition("::")
        if place in self.cells:
            return place
        parameters = name.partition("[")[2]
        # The longest id counts, since one id may be contained in another: `m/py3.1` in `m/py3.11`.
        return max((cell for cell in self.cells if cell in parameters), key=len, default=None) if parameters else None

    def _split_scope(self, nodeid: str) -> str:
        cell = self.cell_of(nodeid)
        return self.groups[cell] if cell else str(super()._split_scope(nodeid))


def by_environment(runner: Runner, cells: Iterable[Cell]) -> dict[str, str]:
    """Lock the cells, as far as `runner` goes. Return group names by cell id: cells that install alike share one."""

    def group(cell: Cell) -> str:
        try:
            record = runner.measure(replace(cell, cases=()))
        except HarnessError:  # its items meet it again, and tell
            return cell.id
        # A lock does not say what its sdists are built with, so equal locks with other builds are other environments.
        question = cell.question
        built = (question.build_constraints, question.build_variables)
        return digest(record.python, record.lock_sha256, built) if record.lock_sha256 else cell.id

    cell_list = tuple(cells)
    with ThreadPoolExecutor(max_workers=capacity.default_jobs()) as pool:
        return dict(zip((cell.id for cell in cell_list), pool.map(group, cell_list), strict=True))

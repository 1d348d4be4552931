"""Estimate from earlier runs how long a cell takes and how much memory it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

from harness.machine.store import Store
from harness.model import Cell, Outcome

UNKNOWN_MB = 2000
"""What a case is taken to need that was never measured."""


class Past:
    """The last records of some cells on one machine."""

    def __init__(self, store: Store, find_machine: Callable[[], str], cells: Iterable[Cell]) -> None:
        """Read the records. `find_machine` may have to look at this machine; it is called only where there are some."""
        summaries = {}
        if store.has_cells():
            machine = find_machine()
            summaries = {cell.id: store.read_summary(machine, cell) for cell in cells}
        self._known = {name: summary for name, summary in summaries.items() if summary}

    def seconds(self, cell: Cell) -> float:
        """Return the seconds that the cell took last time; infinity if unknown, so that it is not left to the last."""
        summary = self._known.get(cell.id)
        ran = summary is not None and any(phase.outcome is not Outcome.NOT_REACHED for phase in summary.phases)
        return summary.seconds if summary and ran else float("inf")

    def memory_mb(self, cell: Cell) -> int:
        """Return the most MB that one of its cases held last time, here or in a like cell; at most its limit."""
        peaks = self._known[cell.id].peaks if cell.id in self._known else {}
        return max((self._case(case.id, case.memory_mb, peaks) for case in cell.cases), default=0)

    def _case(self, case: str, limit: int, peaks: dict[str, int]) -> int:
        return min(limit, peaks.get(case) or self._elsewhere.get(case) or UNKNOWN_MB)

    @cached_property
    def _elsewhere(self) -> dict[str, int]:
        """Return the most MB that a case of each name held in any of the cells."""
        most: dict[str, int] = {}
        for summary in self._known.values():
            for case, peak in summary.peaks.items():
                most[case] = max(peak, most.get(case, 0))
        return most

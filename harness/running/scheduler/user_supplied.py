"""Handle the software that the user brings for a cell: look at it once in a run, copy it when something has to run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from harness.model import Brought, Cell
from harness.packages.sources import user_supplied
from harness.packages.sources.user_supplied import Source
from harness.running.scheduler.steps import Once


def missing(cell: Cell) -> Iterator[str]:
    """Yield a sentence for each thing that the user has not brought: what to do about it."""
    yield from (sentence for bring in cell.bring if (sentence := user_supplied.absent(bring)))


@dataclass(slots=True)
class BroughtSoftware:
    """The software that the user brought for the cells of a run, as it was when a cell first asked for it."""

    offline: bool
    once: Once = field(default_factory=Once)
    seen: dict[str, Source] = field(default_factory=dict)

    def of(self, cell: Cell) -> tuple[Brought, ...]:
        """Return the brought software that a cell is measured with. Raises BadInput if a variable names nothing."""
        return tuple(source.fingerprint for source in self._sources(cell))

    def unpacked(self, cell: Cell) -> tuple[dict[str, Path], tuple[str, ...]]:
        """Return the copies for a cell, by variable, and the folders that it imports modules from.

        The cell's own folders come first, then those of the copies in their order.
        """
        if not cell.bring:
            return {}, cell.python_path
        copies = [(source, user_supplied.copy_source(source)) for source in self._sources(cell)]
        folders = (path for source, copy in copies for path in user_supplied.python_path(source, copy))
        return {source.bring.variable: copy for source, copy in copies}, (*cell.python_path, *folders)

    def _sources(self, cell: Cell) -> Iterator[Source]:
        for bring in cell.bring:
            with self.once.turn(bring.variable):
                if bring.variable not in self.seen:
                    self.seen[bring.variable] = user_supplied.inspect_source(bring, offline=self.offline)
            yield self.seen[bring.variable]

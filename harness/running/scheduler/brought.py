"""What the user brings for a cell: looked at once in a run, copied when something really has to run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from harness.model import Brought, Cell
from harness.running.scheduler.once import Once

if TYPE_CHECKING:
    from harness.packages.sources.user_supplied import Source


def missing(cell: Cell) -> Iterator[str]:
    """What to do about what the user has not brought, a sentence for each."""
    if cell.bring:
        from harness.packages.sources import user_supplied  # noqa: PLC0415 - start-up

        yield from (told for bring in cell.bring if (told := user_supplied.absent(bring)))


@dataclass(slots=True)
class Luggage:
    """What the user brought for the cells of a run, as it was when one of them first asked."""

    offline: bool
    once: Once = field(default_factory=Once)
    seen: dict[str, Source] = field(default_factory=dict)

    def of(self, cell: Cell) -> tuple[Brought, ...]:
        """What it is that a cell is measured with. Raises BadInput where a variable names nothing."""
        return tuple(source.found for source in self._sources(cell))

    def unpacked(self, cell: Cell) -> tuple[dict[str, Path], tuple[str, ...]]:
        """The copies for a cell, by variable, and the folders that it imports modules from, in the order of both."""
        if not cell.bring:
            return {}, cell.python_path
        from harness.packages.sources import user_supplied  # noqa: PLC0415 - start-up

        copies = [(source, user_supplied.copied(source)) for source in self._sources(cell)]
        folders = (path for source, copy in copies for path in user_supplied.python_path(source, copy))
        return {source.bring.variable: copy for source, copy in copies}, (*cell.python_path, *folders)

    def _sources(self, cell: Cell) -> Iterator[Source]:
        for bring in cell.bring:
            from harness.packages.sources import user_supplied  # noqa: PLC0415 - start-up

            with self.once.turn(bring.variable):
                if bring.variable not in self.seen:
                    self.seen[bring.variable] = user_supplied.looked_at(bring, offline=self.offline)
            yield self.seen[bring.variable]

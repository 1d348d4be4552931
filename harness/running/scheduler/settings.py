"""How a run is to be done, and who is told of it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from harness.machine import free_memory
from harness.model import Cell, CellRecord, Phase

if TYPE_CHECKING:
    from harness.running.offline_bundle import Fetched

AUTO = 0
"""As many cells at a time as there are cores, and no more than the free memory has room for."""

WAITING = "wait"
"""The step of a cell whose environment stands and that has no slot yet."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """How a run is to be done; `until` is the last phase wanted.

    `jobs` is how many cells are probed at a time, or `AUTO`, which asks `reading` what memory is left. `fresh`
    measures everything again, `again` what failed.
    """

    jobs: int = 1
    until: Phase = Phase.SUITE
    fresh: bool = False
    again: bool = False
    offline: bool = False
    verify: bool = False
    fetched: Fetched | None = None
    reading: Callable[[], free_memory.Reading] = free_memory.reading


class Observer(Protocol):
    """Is told what goes on, from several threads at once."""

    def started(self, cell: Cell) -> None:
        """A cell is being worked on."""

    def step(self, cell: Cell, text: str) -> None:
        """What it is doing now (`resolve`, `install`, `wait`, a check's name)."""

    def done(self, record: CellRecord) -> None:
        """A cell is finished and stored."""

    def say(self, text: str) -> None:
        """Something to tell the user once."""


def default_jobs() -> int:
    """One cell per core that this process may use; not every Slurm holds a task to the cores that it was given."""
    cores, given = len(os.sched_getaffinity(0)), os.environ.get("SLURM_CPUS_PER_TASK", "")
    return max(1, min(cores, int(given))) if given.isdigit() else cores

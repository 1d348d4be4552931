"""How a run is to be done, and who is told of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from harness.model import Cell, CellRecord, Phase


@dataclass(frozen=True, kw_only=True, slots=True)
class Settings:
    """How a run is to be done; `until` is the last phase wanted."""

    jobs: int = 1
    until: Phase = Phase.RENDER
    fresh: bool = False
    offline: bool = False
    verify: bool = False


class Observer(Protocol):
    """Is told what goes on, from several threads at once."""

    def started(self, cell: Cell) -> None:
        """A cell is being worked on."""

    def step(self, cell: Cell, text: str) -> None:
        """What it is doing now (`resolve`, `install`, a check's name)."""

    def done(self, record: CellRecord) -> None:
        """A cell is finished and stored."""

    def say(self, text: str) -> None:
        """Something to tell the user once."""

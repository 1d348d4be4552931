"""Live progress on stderr: a board on a terminal, one line per finished cell elsewhere."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Self

from harness.model import Cell, CellRecord
from harness.model.report_types import format_count
from harness.reports.text.terminal import limit_width
from harness.running.scheduler import WAITING
from harness.standalone.control_characters import strip_controls
from harness.standalone.output import style_stream

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table


class Progress:
    """Counts of cells done, running, waiting and left, with an estimate of the time to go.

    The estimate counts only cells that were worked on, not those whose result was reused at once.
    """

    def __init__(self, total: int, jobs: int, describe: Callable[[CellRecord], str]) -> None:
        self.total, self.jobs, self.describe = total, jobs, describe
        self.known_count = self.worked_count = 0
        self._running: dict[str, str] = {}
        self._began = monotonic()
        self._lock = threading.Lock()
        self._printing = threading.Lock()
        self._live: Live | None = None

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console  # noqa: PLC0415 - start-up
            from rich.live import Live  # noqa: PLC0415 - start-up

            self._live = Live(
                console=limit_width(Console(file=style_stream(sys.stderr))),
                get_renderable=self._board,
                refresh_per_second=8,
                transient=True,
            )
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()

    def started(self, cell: Cell) -> None:
        """Note that work on a cell has begun."""
        with self._printing:
            with self._lock:
                first = self.known_count and not self.worked_count and not self._running
                self._running[cell.id] = "start"
            if first:
                self.say(f"{self.known_count} of {format_count(self.total, 'cell')} measured before")

    def step(self, cell: Cell, text: str) -> None:
        """Note the current step of a cell."""
        with self._lock:
            self._running[cell.id] = text

    def done(self, record: CellRecord) -> None:
        """Report a finished cell; a cell that was reused without any work is counted only."""
        with self._printing:  # so that lines come in the order of their numbers
            with self._lock:
                begun = self._running.pop(record.cell.id, None) is not None
                if record.reused and not begun:
                    self.known_count += 1
                    return
                self.worked_count += 1
                done = self.known_count + self.worked_count
                line = f"[{done}/{self.total}] {record.cell.id}: {self.describe(record)}"
                line = line if self._live or done == self.total else f"{line} ({self._summary()})"
            # The board's own thread holds rich's lock while it waits for ours: we never print with ours held.
            self.say(line)

    def say(self, text: str) -> None:
        """Print a message for the user once."""
        if self._live:
            self._live.console.print(strip_controls(text), markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)

    def _summary(self) -> str:
        running = sum(step != WAITING for step in self._running.values())
        left = self.total - self.known_count - self.worked_count - running
        spent = monotonic() - self._began
        if not self.worked_count:
            return f"{running} running, {left} left"
        to_go = spent / self.worked_count * (running + left)
        return f"{running} running, {left} left, about {to_go:.0f} s to go"

    def _board(self) -> Table:
        from rich.table import Table  # noqa: PLC0415 - start-up

        board = Table.grid(padding=(0, 2))
        with self._lock:
            board.add_row(f"{self.known_count + self.worked_count} of {self.total} done", self._summary())
            active = {name: step for name, step in self._running.items() if step != WAITING}
            for name, step in sorted(active.items()):
                board.add_row(f"  {strip_controls(step)}", name)
            if waiting := len(self._running) - len(active):
                board.add_row(f"  {WAITING}", format_count(waiting, "cell") + ", installed")
        return board

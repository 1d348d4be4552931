"""Live progress on stderr: a board on a terminal, one line per finished cell elsewhere."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from time import monotonic
from types import TracebackType
from typing import TYPE_CHECKING, Self, TypeVar

from harness.judging.exercised import unregistered_id
from harness.machine.capacity import default_jobs
from harness.machine.console import limit_width
from harness.model import Cell, CellRecord, Verdict
from harness.model.report_types import format_count, format_duration
from harness.running.scheduler import WAITING
from harness.standalone.control_characters import strip_controls
from harness.standalone.output import style_stream

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

Item = TypeVar("Item")
BAR = 30
"""Columns of the bar."""
QUIET_SECONDS = 10.0
"""Seconds between two lines of progress, if no terminal shows a bar."""


def headline(record: CellRecord) -> str:
    """Return one line about a finished cell, for the progress display."""
    from harness.judging.assess import assess  # noqa: PLC0415 - start-up

    judged = assess(record)
    where = f" in {judged.phase}" if judged.phase and judged.verdict is not Verdict.UNAVAILABLE else ""
    note = " (reused)" if record.reused else f" ({record.seconds:.1f} s)"
    if record.cell.asked and unregistered_id(record):
        return f"no such environment{note}"
    return f"{judged.verdict}{where}{note}"


class Progress:
    """Counts of cells done, running, waiting and left, with an estimate of the time to go.

    `earlier` returns the seconds that cells took before, by id. It is called when they are first shown or counted: no
    cell waits for it before it is measured, and a run that reuses all results not at all. Without such seconds, all
    cells count alike. The speed is that of the cells which this run worked on; a cell whose result was reused at once
    tells nothing about it.
    """

    def __init__(
        self,
        total: int,
        jobs: int,
        describe: Callable[[CellRecord], str],
        earlier: Callable[[], Mapping[str, float]] = dict,
    ) -> None:
        self.total, self.jobs, self.describe = total, jobs if jobs > 0 else default_jobs(), describe
        self.known_count = self.worked_count = 0
        self._earlier: Callable[[], Mapping[str, float]] | None = earlier
        self._seconds: dict[str, float] = {}
        self._running: dict[str, str] = {}
        # Sums, since each line of a run of thousands of cells says how long the rest takes.
        self._seconds_of_all = self._seconds_of_worked = 0.0
        self._timed_count = 0
        self._reused: set[str] = set()
        self._began = self._last = monotonic()
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
                first = not self.worked_count and not self._running
                self._running[cell.id] = "start"
            if first and self.known_count:
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
                    self._reused.add(record.cell.id)
                    self._seconds_of_all -= self._seconds.pop(record.cell.id, 0.0)
                    return
                self._read_earlier()
                self.worked_count += 1
                self._timed_count += record.cell.id in self._seconds
                self._seconds_of_worked += self._seconds.get(record.cell.id, 0.0)
                self._last = monotonic()
                done = self.known_count + self.worked_count
                line = f"[{done}/{self.total}] {record.cell.id}: {self.describe(record)}"
                line = line if self._live or done == self.total else f"{line} ({self.summary()})"
            # The board's own thread holds rich's lock while it waits for ours: we never print with ours held.
            self.say(line)

    def _read_earlier(self) -> None:
        """Ask once for the seconds that cells took before; those of reused cells do not count."""
        if self._earlier:
            earlier, self._earlier = self._earlier(), None
            self._seconds = {name: earlier[name] for name in earlier.keys() - self._reused}
            self._seconds_of_all = sum(self._seconds.values())

    def say(self, text: str) -> None:
        """Print a message for the user once."""
        if self._live:
            self._live.console.print(strip_controls(text), markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)

    def summary(self) -> str:
        """Return what is running, what is left, and about how long it takes."""
        if not self.total:
            return f"{format_duration(monotonic() - self._began)} so far"
        running = sum(step != WAITING for step in self._running.values())
        left = self.total - self.known_count - self.worked_count - running
        to_go = self._to_go(running + left)
        return f"{running} running, {left} left" + ("" if to_go is None else f", about {format_duration(to_go)} to go")

    def _to_go(self, unfinished: int) -> float | None:
        """Return the seconds to go, or None if neither this run nor an earlier one measured a cell."""
        self._read_earlier()
        if not (self.worked_count or self._seconds):
            return None
        # A cell that nobody measured before counts as the mean of the others.
        mean = self._seconds_of_all / len(self._seconds) if self._seconds else 1.0
        done = self._seconds_of_worked + (self.worked_count - self._timed_count) * mean
        timed = len(self._seconds) - self._timed_count
        work = self._seconds_of_all - self._seconds_of_worked + max(unfinished - timed, 0) * mean
        spent, since = self._last - self._began, monotonic() - self._last
        # Before the first cell is done, the cells are supposed to take as long as before, `jobs` of them at a time.
        return max(work * (spent / done if self.worked_count and done else 1 / self.jobs) - since, 0.0)

    def _board(self) -> RenderableType:
        from rich.console import Group  # noqa: PLC0415 - start-up
        from rich.progress_bar import ProgressBar  # noqa: PLC0415 - start-up
        from rich.table import Table  # noqa: PLC0415 - start-up

        head, board = Table.grid(padding=(0, 2)), Table.grid(padding=(0, 2))
        with self._lock:
            done = self.known_count + self.worked_count
            if self.total:
                bar = ProgressBar(total=self.total, completed=done, width=BAR)
                head.add_row(bar, f"{done} of {self.total} done, {self.summary()}")
            else:
                head.add_row(self.summary())
            active = {name: step for name, step in self._running.items() if step != WAITING}
            for name, step in sorted(active.items()):
                board.add_row(f"  {strip_controls(step)}", name)
            if waiting := len(self._running) - len(active):
                board.add_row(f"  {WAITING}", format_count(waiting, "cell") + ", installed")
        return Group(head, board)


class SearchProgress(Progress):
    """Shows a search, whose next cell depends on the last one: it prints what the search says, and no line per cell.

    `runs` and `minutes` are the bounds of the search, if it has any. The time to go is at most what they allow, by the
    mean duration of the cells that were measured.
    """

    def __init__(self, runs: int | None = None, minutes: float | None = None) -> None:
        super().__init__(0, 1, lambda record: record.cell.id)
        self.runs, self.minutes = runs, minutes

    def step(self, cell: Cell, text: str) -> None:
        """Note the current step of the cell that is measured; others are prepared in the background."""
        with self._lock:
            if cell.id in self._running:
                self._running[cell.id] = text

    def done(self, record: CellRecord) -> None:
        """Count a cell that was measured. The search prints its result."""
        with self._lock:
            if self._running.pop(record.cell.id, None) is not None:
                self.worked_count += 1
                self._last = monotonic()

    def summary(self) -> str:
        """Return how many cells were measured, in which time, and how long it takes at most."""
        spent, most = monotonic() - self._began, []
        bound = f" of at most {self.runs}" if self.runs is not None else ""
        parts = [f"{self.worked_count}{bound} measured in {format_duration(spent)}"]
        if self.minutes is not None:
            most.append(self.minutes * 60 - spent)
        if self.worked_count:
            each = (self._last - self._began) / self.worked_count
            parts.append(f"about {format_duration(each)} each")
            most += [] if self.runs is None else [(self.runs - self.worked_count) * each]
        parts += [f"at most {format_duration(max(min(most), 0.0))} to go"] if most else []
        return ", ".join(parts)


def count_off(items: Sequence[Item], noun: str) -> Iterator[Item]:
    """Yield items, with their count and the time to go on stderr: a bar on a terminal, else a line now and then.

    The estimate is the mean time of the items before. Fewer than two items are yielded without a word.
    """
    began = printed = monotonic()
    with _bar(len(items)) as advance:
        for number, item in enumerate(items):
            now = monotonic()
            if advance is None and number and now - printed > QUIET_SECONDS:
                printed, to_go = now, (now - began) / number * (len(items) - number)
                text = f"{number} of {format_count(len(items), noun)} done, about {format_duration(to_go)} to go"
                print(text, file=sys.stderr, flush=True)
            yield item
            if advance:
                advance()


@contextmanager
def _bar(total: int) -> Iterator[Callable[[], None] | None]:
    """Show a bar while the block lasts; yield the function that moves it on, None where no terminal shows it."""
    if total < 2 or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console  # noqa: PLC0415 - start-up
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn  # noqa: PLC0415 - start-up
    from rich.progress import Progress as Bar  # noqa: PLC0415 - start-up

    console = limit_width(Console(file=style_stream(sys.stderr)))
    columns = (BarColumn(BAR), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("to go"))
    # What is printed meanwhile goes above the bar, unless stdout is a file or a pipe.
    with Bar(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as bar:
        task = bar.add_task("", total=total)
        yield lambda: bar.advance(task)

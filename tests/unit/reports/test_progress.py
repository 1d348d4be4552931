"""Test the progress of long work: the time to go, and a board that rich draws in a thread of its own."""

import threading

import pytest
from builders import cell, record

from harness.model import Cell, CellRecord, replace
from harness.model.report_types import format_duration
from harness.reports.text import progress
from harness.reports.text.progress import Progress, SearchProgress


class Drawn(Progress):
    """A board that is drawn by another thread during each line, as rich may do."""

    def say(self, text: str) -> None:
        """Draw the board elsewhere; note whether that had to wait for us."""
        drawing = threading.Thread(target=self._board, daemon=True)
        drawing.start()
        drawing.join(10)
        assert not drawing.is_alive(), text


def test_a_line_and_the_board_never_wait_for_each_other() -> None:
    """A deadlock of the two would end all output of a run."""
    progress = Drawn(3, 1, lambda each: each.cell.id)
    progress.done(record())
    progress.started(cell())
    progress.done(record())
    assert progress.worked_count + progress.known_count == 2


class Clock:
    """A clock that a test moves on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Replace the clock of the module."""
    mine = Clock()
    monkeypatch.setattr(progress, "monotonic", mine)
    return mine


def cells(count: int) -> list[Cell]:
    """Return cells with ids of their own."""
    return [replace(cell(), id=f"m/{number}") for number in range(count)]


def finished(each: Cell) -> CellRecord:
    """Return the record of a cell that was measured just now."""
    return replace(record(), cell=each)


def test_the_time_to_go_is_that_of_cells_measured_in_this_run(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    """Without earlier results there is none before a cell is done; then all cells count alike."""
    first, *_ = cells(4)
    board = Progress(4, 2, lambda each: "works")
    board.started(first)
    assert board.summary() == "1 running, 3 left"
    clock.now += 200
    board.done(finished(first))
    assert capsys.readouterr().err == "[1/4] m/0: works (0 running, 3 left, about 10 min to go)\n"


def test_earlier_results_tell_the_time_to_go_at_once(clock: Clock) -> None:
    """Before a cell is done as they were, shared by the jobs; a machine of half the speed doubles what is left."""
    first, *rest = cells(4)
    seconds = dict(zip([each.id for each in (first, *rest)], [10.0, 100.0, 100.0, 190.0], strict=True))
    board = Progress(4, 2, lambda each: "works", lambda: seconds)
    board.started(first)
    assert board.summary() == "1 running, 3 left, about 3 min to go"  # 400 s by 2 jobs
    clock.now += 20
    board.done(finished(first))
    assert board.summary() == "0 running, 3 left, about 13 min to go"  # 390 s, at 2 s for each
    clock.now += 60
    assert board.summary() == "0 running, 3 left, about 12 min to go"


def test_a_reused_cell_is_no_work(clock: Clock) -> None:
    """Its earlier seconds are neither left nor done."""
    first, second = cells(2)
    board = Progress(2, 1, lambda each: "works", lambda: {first.id: 500.0, second.id: 30.0})
    board.done(replace(finished(first), reused=True))
    board.started(second)
    assert board.summary() == "1 running, 0 left, about 30 s to go"


def test_a_search_ends_within_its_bounds(clock: Clock) -> None:
    """Time to go is what bounds allow, by the mean of measured cells; a cell at hand is not counted."""
    first, second = cells(2)
    board = SearchProgress(runs=3, minutes=60)
    board.started(first)
    clock.now += 100
    board.step(second, "install")  # prepared in the background
    board.done(finished(first))
    board.done(finished(second))
    assert board.summary() == "1 of at most 3 measured in 2 min, about 2 min each, at most 3 min to go"


def test_items_are_counted_off_now_and_then(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    """Elsewhere than on a terminal, a line tells the count and the time to go, not more than once in ten seconds."""
    for _ in progress.count_off("abcd", "report"):
        clock.now += 8
    assert capsys.readouterr().err == "2 of 4 reports done, about 16 s to go\n"


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (89, "89 s"), (90, "2 min"), (5360, "89 min"), (5400, "1 h 30 min")]
)
def test_a_duration_has_the_unit_that_says_enough(seconds: float, text: str) -> None:
    """Seconds below 90, minutes below 90, then hours."""
    assert format_duration(seconds) == text

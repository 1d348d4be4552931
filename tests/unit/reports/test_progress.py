"""Test that the board can be drawn while a line is printed: rich draws it in a thread of its own."""

import threading

from builders import cell, record

from harness.reports.text.progress import Progress


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

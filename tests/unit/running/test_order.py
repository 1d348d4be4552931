"""The order of cells: the longest first, and Pythons in turn."""

from __future__ import annotations

from builders import cell_requiring

from harness.model import Cell
from harness.running.scheduler.flow import order


def cell(name: str, python: str) -> Cell:
    """Return a cell of a Python."""
    return cell_requiring(name, id=f"m/{name}", python=python)


def test_pythons_take_turns() -> None:
    """Of cells that take as long, one of each Python comes before the second of any."""
    cells = [cell("a", "3.10"), cell("b", "3.10"), cell("c", "3.11"), cell("d", "3.11"), cell("e", "3.12")]
    places = order(cells, lambda _: 1.0)
    assert [one.label for one in sorted(cells, key=lambda one: places[one.id])] == ["a", "c", "e", "b", "d"]


def test_the_longest_goes_first_whatever_its_python() -> None:
    """Known seconds count before the turns."""
    cells = [cell("a", "3.10"), cell("b", "3.10"), cell("c", "3.11")]
    places = order(cells, lambda one: {"a": 1.0, "b": 9.0, "c": 5.0}[one.label])
    assert [one.label for one in sorted(cells, key=lambda one: places[one.id])] == ["b", "c", "a"]

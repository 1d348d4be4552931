"""An unforeseen error in one cell makes it inconclusive, and all other cells are measured."""

from __future__ import annotations

from pathlib import Path

import pytest
from commandline import SMALL, Desk

HERE = str(Path(__file__).parent)
SAID = "a fault of simmatrix, not of the packages: IndexError: list index out of range"


@pytest.mark.parametrize("place", ["install", "measure", "control"])
def test_a_bug_in_one_cell(desk: Desk, place: str) -> None:
    """The other cell works, the traceback is kept, and the next run measures the failed cell again."""
    matrix = desk.matrix("small", SMALL.read_text(encoding="utf-8"))
    ran = desk.run("run", matrix, "--json", module="harness_with_a_bug", BUG=place, PYTHONPATH=HERE)
    cells = ran.cells("which")
    assert (ran.code, cells["good"]["verdict"]) == (3, "works")
    assert (cells["blank"]["verdict"], cells["blank"]["decisive"]) == ("inconclusive", SAID)
    assert cells["blank"]["as_expected"] is None
    (told,) = (line for line in ran.err.splitlines() if "a fault of simmatrix" in line and "report it" in line)
    kept = told.partition("please report it with ")[2]
    text = (desk.state / kept).read_text(encoding="utf-8")
    assert text.startswith("Traceback (most recent call last):")
    assert text.endswith("IndexError: list index out of range\n")
    assert "Traceback" not in ran.err
    assert str(desk.folder) not in text
    again = desk.run("run", matrix, "--json").cells("which")
    assert (again["good"]["reused"], again["blank"]["verdict"]) == (True, "partial")


def test_a_record_that_cannot_be_stored(desk: Desk) -> None:
    """A record that cannot be stored is reported all the same."""
    matrix = desk.matrix("small", SMALL.read_text(encoding="utf-8"))
    ran = desk.run("run", matrix, "--json", module="harness_with_a_bug", BUG="store", PYTHONPATH=HERE)
    cells = ran.cells("which")
    assert (ran.code, cells["good"]["verdict"], cells["blank"]["verdict"]) == (1, "works", "partial")
    assert "it cannot be stored: list index out of range" in ran.err


def test_an_interrupt_is_no_fault_of_a_cell(desk: Desk) -> None:
    """Bad input in one cell ends the run with code 2."""
    matrix = desk.matrix("small", SMALL.read_text(encoding="utf-8"))
    ran = desk.run("run", matrix, "--json", HARNESS_SANDBOX="none")
    assert (ran.code, ran.out) == (2, "")


IMPOSSIBLE = """
[axes.which.impossible]
requirements = ["fake-healthy @ file:///etc/hostname"]
"""


def test_an_unusable_requirement_fails_only_its_own_cell(desk: Desk) -> None:
    """A requirement that the resolver cannot use makes its cell unresolvable; the others are measured."""
    text = SMALL.read_text(encoding="utf-8").replace("[axes.which.odd]", f"{IMPOSSIBLE}[axes.which.odd]")
    ran = desk.run("run", desk.matrix("small", text), "--json")
    assert ran.out, ran.err
    cells = ran.cells("which")
    assert (ran.code, cells["good"]["verdict"], cells["blank"]["verdict"]) == (1, "works", "partial")
    assert cells["impossible"]["verdict"] == "unresolvable"
    assert "uv cannot use its input" in cells["impossible"]["decisive"]


@pytest.mark.parametrize(("name", "value"), [("PYTHONHOME", "/x"), ("PYTHONMALLOC", "bad")])
def test_a_variable_that_stops_python_blames_no_package(desk: Desk, name: str, value: str) -> None:
    """Python starts neither with nor without what is installed: that says nothing about packages."""
    text = SMALL.read_text(encoding="utf-8")
    ran = desk.run("run", desk.matrix("small", f'environment = {{ {name} = "{value}" }}\n{text}'), "--json")
    assert {cell["verdict"] for cell in ran.cells("which").values()} == {"inconclusive"}

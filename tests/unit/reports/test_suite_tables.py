"""The package's own tests as a column, and which of them differ from the neighbouring cell."""

from __future__ import annotations

import re

import msgspec
import pytest
from builders import diagnosis
from specimens import moved, quick_document

from harness.model import Outcome
from harness.model.report_types import CellEntry, SuiteEntry
from harness.reports.tables import suite_tables, tables
from harness.reports.template_files import read_template
from harness.reports.text import report_markdown

AXES = ("python", "gymnasium")
TEMPLATE = read_template(report_markdown.TEMPLATE)


def cell(gymnasium: str, suite: SuiteEntry | None, python: str = "3.11") -> CellEntry:
    """Return a working cell with the result of its package's own tests."""
    return moved(4, {"python": python, "gymnasium": gymnasium}, suite=suite, unverified=())


def suite(*failed: str, passed: int = 50, **more: object) -> SuiteEntry:
    """Return a suite in which these tests failed."""
    plain = {
        "outcome": Outcome.FAILED if failed else Outcome.PASSED,
        "tests": {"passed": passed, "failed": len(failed), "skipped": 2},
        "decisive": f"{failed[0]}: boom" if failed else None,
        "evidence": None,
        "failed": failed or msgspec.UNSET,
    }
    return SuiteEntry(**{**plain, **more})


NOT_RUN = SuiteEntry(
    outcome=Outcome.NOT_REACHED,
    tests={},
    decisive="error: command 'swig' failed",
    evidence=None,
    diagnoses=(diagnosis("box2d-py-swig", cause="c"),),
)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (None, ""),
        (suite(), "50 of 52 passed"),
        (suite("a", "b"), "50 of 54 passed, 2 failed"),
        (NOT_RUN, "could not run: box2d-py-swig"),
        (suite(outcome=Outcome.TIMED_OUT, tests={}), "timed out"),
    ],
)
def test_words_of_a_suite(result: SuiteEntry | None, words: str) -> None:
    """A suite's words are how many of all passed, or why it could not run."""
    assert suite_tables.tests(cell("1.4.0", result)) == words


def test_tests_that_differ_from_the_neighbour() -> None:
    """Beside the release before: what fails here alone, and what fails there alone; Python is compared last."""
    cells = [cell("1.3.0", suite("a", "b")), cell("1.1.0", suite("a", "b")), cell("1.4.0", suite("b", "c", "d"))]
    cells += [cell("1.4.0", suite("b", "c", "d"), "3.12"), cell("1.3.0", suite("a", "b"), "3.12")]
    found = {one.cell: one for one in suite_tables.changes(cells, AXES)}
    newest = found["py3.11_gymnasium-1.4.0"]

    assert (newest.neighbour, newest.fails, newest.passes) == ("py3.11_gymnasium-1.3.0", ("c", "d"), ("a",))
    assert found["py3.11_gymnasium-1.3.0"].neighbour == "py3.11_gymnasium-1.1.0"
    assert (found["py3.11_gymnasium-1.3.0"].fails, found["py3.11_gymnasium-1.3.0"].passes) == ((), ())


def test_a_suite_that_could_not_run_is_compared_with_nothing() -> None:
    """Its known issue is named, and the cell keeps its own verdict."""
    cells = [cell("1.3.0", suite("a")), cell("1.4.0", NOT_RUN)]
    (_, lacking) = suite_tables.changes(cells, AXES)

    assert (lacking.known, lacking.neighbour, lacking.fails) == ("box2d-py-swig", "", ())


def test_page_with_suites() -> None:
    """A column of its own, and a table of the tests that differ."""
    made = quick_document()
    cells = (cell("1.3.0", suite("a")), cell("1.4.0", suite("b", "c", "d", "e")), cell("1.5.0", NOT_RUN))
    text = report_markdown.markdown(tables.report(msgspec.structs.replace(made, cells=cells)), TEMPLATE)

    assert re.search(r"\| result \| combination \| .*own tests \|", text)
    assert "| 50 of 56 passed, 4 failed |" in text
    (row,) = [line for line in text.splitlines() if line.startswith("| `py3.11_gymnasium-1.4.0`")]
    assert row == (
        "| `py3.11_gymnasium-1.4.0` | 50 of 56 passed, 4 failed | `b`, `c`, `d` and 1 more | `a` |"
        " `py3.11_gymnasium-1.3.0` | `b: boom` |"
    )
    assert "| could not run: box2d-py-swig | - | - | - | `box2d-py-swig`: `error: command 'swig' failed` |" in text


def test_page_without_suites() -> None:
    """No matrix that has no suite gets a column for it."""
    assert "own tests" not in report_markdown.markdown(tables.report(quick_document()), TEMPLATE)

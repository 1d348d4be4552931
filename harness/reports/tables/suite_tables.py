"""Summarise the package's own tests: how many passed in each cell, and which differ in the neighbouring cell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from harness.model import Outcome
from harness.model.report_types import CellEntry, SuiteEntry, word
from harness.reports.tables import cause_groups
from harness.reports.tables.squares import NOTHING
from harness.reports.tables.table_types import SuiteChange


def tests(cell: CellEntry) -> str:
    """Return `812 of 830 passed, 7 failed`; of a suite that counted no tests, how it ended and the known issue."""
    suite = cell.suite
    if suite is None:
        return ""
    if not suite.total:
        issue = _find_issue(suite)
        words = "could not run" if suite.not_run else word(suite.outcome)
        return f"{words}: {issue}" if issue else words
    bad = sum(suite.tests.get(how, 0) for how in ("failed", "error"))
    return f"{suite.tests.get('passed', 0)} of {suite.total} passed" + (f", {bad} failed" if bad else "")


def _find_issue(suite: SuiteEntry) -> str:
    return next((one.signature for one in suite.diagnoses or ()), "")


def changes(cells: Sequence[CellEntry], axes: Sequence[str]) -> Iterator[SuiteChange]:
    """Yield each cell whose tests fail, with the tests that end differently in a neighbouring cell."""
    for cell in cells:
        suite = cell.suite
        if suite is None or suite.outcome in {Outcome.PASSED, Outcome.SKIPPED, Outcome.UNAVAILABLE}:
            continue
        beside = [one for one in cells if one.machine == cell.machine and one.suite and one.suite.total]
        near = list(_neighbours(cell, beside, axes)) if suite.total else []
        other = next((one for one in near if _failed(one) != _failed(cell)), near[0] if near else None)
        here, there = _failed(cell), _failed(other) if other else set()
        yield SuiteChange(
            cell=cell.label,
            tests=tests(cell),
            decisive=suite.decisive or "",
            known=_find_issue(suite),
            neighbour=other.label if other else "",
            fails=tuple(sorted(here - there)),
            passes=tuple(sorted(there - here)),
        )


def _failed(cell: CellEntry) -> set[str]:
    return {*((cell.suite.failed or ()) if cell.suite else ())}


def _neighbours(cell: CellEntry, others: Sequence[CellEntry], axes: Sequence[str]) -> Iterator[CellEntry]:
    """Yield, for each axis, the cell with the value before (else after) and all others equal; Python last."""
    for axis in sorted(axes, key=lambda name: name == "python"):
        alike = {
            one.axes.get(axis, NOTHING): one
            for one in others
            if all(one.axes.get(other) == cell.axes.get(other) for other in axes if other != axis)
        }
        values = cause_groups.in_order([*alike, cell.axes.get(axis, NOTHING)])
        at = values.index(cell.axes.get(axis, NOTHING))
        places = [place for place in (at - 1, at + 1) if 0 <= place < len(values)]
        yield from [alike[values[place]] for place in places if values[place] in alike][:1]

"""Hold the expectation of a cell against its verdict; give the exit code of the whole."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Protocol

from harness.model import Cell, Expectation, Observation, Outcome, Phase, Verdict
from harness.model.report_types import SEVERITY, UNTOLD
from harness.model.words import contains as observes
from harness.model.words import sentence_pattern
from harness.standalone.failures.silent import plainly_good

Names = Callable[[], Collection[str]]
"""Gives the ids of the known failures that an expectation may name; called only where one names any."""


class Judged(Protocol):
    """A cell with its verdict, the first phase that decided it, and the line that says why."""

    @property
    def verdict(self) -> Verdict:
        """Return the verdict."""

    @property
    def phase(self) -> Phase | None:
        """Return the phase that decided."""

    @property
    def decisive(self) -> str | None:
        """Return the line that says why."""

    @property
    def observed(self) -> Observation | None:
        """Return the cell's observation behind that line; None if the line is not ours, or it is unknown."""


def compare_expected(cell: Cell, judged: Judged, today: str, names: Names) -> tuple[bool | None, str | None]:
    """Return whether a cell is as expected (None where nothing can be said), and why its expectation is stale, if so.

    `today` is an ISO date or instant. A cell without expectation is expected to work.
    """
    judgeable = not (cell.tried and cell.tried.proving)
    stale = reason_stale(cell.id, judged.verdict, cell.expect, today) if cell.expect else None
    return is_met(cell.expect, judged, names) if judgeable else None, stale


def is_met(expect: Expectation | None, judged: Judged, names: Names) -> bool | None:
    """Return whether a verdict is what was expected; None where it says nothing about the packages."""
    if judged.verdict in UNTOLD:
        return None
    if expect is None:
        return judged.verdict is Verdict.WORKS
    # `names` stands last: it may read signatures and logs.
    return (
        judged.verdict is expect.verdict
        and expect.phase in {None, judged.phase}
        and matches_line(expect, judged.decisive, judged.observed)
        and (expect.signature is None or expect.signature in names())
    )


def matches_line(expect: Expectation, line: str | None, seen: Observation | None) -> bool:
    """Return whether a line and the observation behind it are as expected. Old documents have the line alone."""
    if expect.code is not None and seen is not None:
        return observes(expect.code, expect.data, seen)
    if expect.code is not None:
        return re.search(sentence_pattern(expect.code, expect.data), line or "") is not None
    return expect.match is None or re.search(expect.match, line or "") is not None


def is_fulfilled(verdict: Verdict, phases: Mapping[Phase, Outcome], unverified: Iterable[str] = ()) -> bool:
    """Return whether a cell is plainly good, or at least does all that was asked for: import alone never `works`."""
    outcomes = {outcome for outcome in phases.values() if outcome is not Outcome.SKIPPED}
    imports = phases.get(Phase.IMPORT) is Outcome.PASSED and outcomes == {Outcome.PASSED}
    return plainly_good(verdict, unverified) or (verdict is Verdict.NOT_RUN and imports)


def reason_stale(cell_id: str, verdict: Verdict, expect: Expectation, today: str) -> str | None:
    """Return why the expectation of a cell is stale: the cell does better, or its time has passed."""
    if verdict not in UNTOLD and SEVERITY.index(verdict) > SEVERITY.index(expect.verdict):
        return f"{cell_id} does better than expected: {verdict} instead of {expect.verdict}"
    if is_over(expect, today):
        return f"{cell_id} was expected to be {expect.verdict} until {expect.until}, which has passed"
    return None


def is_over(expect: Expectation, today: str) -> bool:
    """Return whether the last day of an expectation is over."""
    # Dates of this form compare as texts; without a `today`, its empty text is before every day.
    return bool(expect.until) and today[:10] > str(expect.until)[:10]


def exit_code(judged: Iterable[tuple[Verdict, bool | None]], *, stale: bool, fail_on: Collection[str]) -> int:
    """Return the exit code of verdicts with their `as_expected`: 1 before 3 before 0.

    `fail_on` names verdicts that are to fail whatever was expected, `unexpected` for what is not as expected, and
    `stale` for expectations out of date.
    """
    verdicts = tuple(judged)
    unexpected = "unexpected" in fail_on and any(right is False for _, right in verdicts)
    if unexpected or (stale and "stale" in fail_on) or any(verdict in fail_on for verdict, _ in verdicts):
        return 1
    return 3 if any(verdict is Verdict.INCONCLUSIVE for verdict, _ in verdicts) else 0

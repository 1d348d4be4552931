"""Judge a run of somebody's test suite by pytest's exit code, its report, and the end of its process."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

from harness.judging.runs.check import Ending
from harness.model import Outcome
from harness.model.machine_trouble import MACHINE_TROUBLE, SHOT
from harness.standalone.failures.lines import SILENT, decisive_line, describe_death

PASSED, FAILED, INTERRUPTED, INTERNAL, USAGE, NO_TESTS = range(6)
"""Exit codes of pytest; a test file that cannot be imported interrupts it."""

LOADING_CONFTEST = "while loading conftest"
"""A conftest that cannot be imported is a usage error for pytest, and yet a fault of what it imports."""


MOST_NAMED, LONGEST_NAME = 1000, 300
"""Tests that are named, and characters of a name: a suite may write anything."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """The tests of a run, counted by how they ended (`passed`, `failed`, `error`, `skipped`).

    `fault` is the first that went wrong with its message, `bad` names those that failed or raised, the first of them.
    """

    tests: Mapping[str, int]
    fault: str | None = None
    bad: tuple[str, ...] = ()

    @classmethod
    def read(cls, junit: str) -> Report:
        """Read a JUnit report. Files of a run are not trusted: a report that is no plain XML counts as none."""
        try:
            # A document type may declare entities that grow without end, and pytest writes none.
            root = ElementTree.fromstring(junit) if junit and "<!DOCTYPE" not in junit else None
        except ElementTree.ParseError:
            root = None
        counts: Counter[str] = Counter()
        fault = None
        bad: list[str] = []
        for case in root.iter("testcase") if root is not None else ():
            ended = {child.tag: child for child in case}
            how = next((name for name in ("error", "failure", "skipped") if name in ended), "passed")
            counts[{"failure": "failed"}.get(how, how)] += 1
            if how in {"error", "failure"}:
                named = ".".join(filter(None, (case.get("classname"), case.get("name"))))
                fault = fault or f"{named}: {_message(ended[how])}"
                bad.append(named[:LONGEST_NAME])
        names = tuple(dict.fromkeys(bad))[:MOST_NAMED]  # a test and its teardown may both go wrong
        return cls(tests=dict(sorted(counts.items())), fault=fault, bad=names)


def outcome_of(report: Report, ending: Ending, text: str) -> tuple[Outcome, str | None]:
    """Return the outcome of a suite and the line that says why. `text` is all that the run printed."""
    if ending.trouble:
        return Outcome.INFRA, ending.trouble
    if ending.overran is not None:
        return Outcome.TIMED_OUT, f"no end within {ending.overran:g} s"
    if ending.signal == signal.SIGKILL:
        return Outcome.INFRA, SHOT
    if ending.signal:
        return Outcome.CRASHED, describe_death(ending.exit_code, ending.signal, text)
    outcome, decisive = _by_code(ending.exit_code or 0, report, text)
    if outcome is Outcome.FAILED and MACHINE_TROUBLE.search(decisive or ""):
        return Outcome.INFRA, decisive
    return outcome, decisive


def _by_code(code: int, report: Report, text: str) -> tuple[Outcome, str | None]:
    """Return the outcome for an exit code. A code that is not pytest's own ended Python, whatever set it."""
    if code in {PASSED, NO_TESTS}:
        if code == PASSED and report.tests.get("passed"):
            return Outcome.PASSED, None
        skipped = report.tests.get("skipped", 0)
        return Outcome.SKIPPED, f"all {skipped} tests were skipped" if skipped else "there is no test to run"
    if code == INTERNAL:
        return Outcome.INFRA, f"pytest itself failed: {_last(text)}"
    if code == USAGE and LOADING_CONFTEST not in text:
        return Outcome.INFRA, f"pytest cannot be run like this: {_last(text)}"
    if code in {FAILED, INTERRUPTED, USAGE}:
        return Outcome.FAILED, _failure(report, text)
    return Outcome.CRASHED, f"Python ended with code {code}: {_last(text)}"


def _failure(report: Report, text: str) -> str:
    bad = sum(report.tests.get(name, 0) for name in ("failed", "error"))
    return f"{report.fault} ({bad} of {sum(report.tests.values())} tests)" if report.fault else _last(text)


def _last(text: str) -> str:
    """Return the last line that reports an error, else the last line."""
    lines = [line.strip() for line in text.splitlines() if line.strip(" =-_")]
    errors = [line for line in lines if line.startswith(("ERROR", "E  ", "INTERNALERROR>", "FAIL"))]
    last_line = (errors or lines or [SILENT])[-1]
    return last_line.removeprefix("E  ").removeprefix("INTERNALERROR>").removeprefix("ERROR:").strip()


def _message(element: ElementTree.Element) -> str:
    """Return pytest's message of a failure; for an error at collection, the line from the text below it."""
    message = (element.get("message") or "").strip()
    if message and message != "collection failure":
        return message.splitlines()[0]
    text = element.text or ""
    marked = [line[1:].strip() for line in text.splitlines() if line.startswith("E ")]  # pytest's mark of an exception
    return decisive_line("\n".join(marked) or text) or message or SILENT

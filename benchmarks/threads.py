"""Hold threads of users beside what was measured: `python -m benchmarks.threads` writes `benchmarks/threads.md`."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from harness.model.report_types import CellEntry
from harness.reports import document
from harness.reports.tables import family_tables

HERE = Path(__file__).parent
HEAD = """# Threads, and what we measured

Made by `python -m benchmarks.threads` from `threads.toml` and the committed reports. What a thread says is its own.
Below it stands what each environment of a report does from the same states.
"""


def main() -> None:
    """Write the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    threads = tomllib.loads((HERE / "threads.toml").read_text(encoding="utf-8"))["threads"]
    page = "\n".join([HEAD, *(line for thread in threads for line in _lines(thread))])
    (HERE / "threads.md").write_text(page, encoding="utf-8")
    print(page)


def _lines(thread: dict[str, Any]) -> Iterator[str]:
    folder = HERE.parent / "reports" / thread["report"]
    report = document.read_file(folder / "report.json")
    wanted = (thread["axis"], thread["before"], thread["after"])
    cells, boundaries = family_tables.call_by_ids(report.cells, report.boundaries or ())
    boundaries = tuple(one for one in boundaries if (one.axis, one.before, one.after) == wanted)
    yield f"## [{thread['thread'].partition('github.com/')[2]}]({thread['thread']})\n"
    yield f"The thread: {thread['says']}.\n"
    sides = [_stepped(cells, thread["axis"], thread[side]) for side in ("before", "after")]
    report_link = f"[{thread['report']}](../reports/{thread['report']}/report.md)"
    yield f"Measured in {report_link}, {thread['before']} to {thread['after']}:\n"
    for change in family_tables.changes(boundaries):
        yield from (f"- {env}: {text}." for env, text in change.lines)
    others = sorted((sides[0] & sides[1]) - {str(one.env) for one in boundaries})
    if others:
        yield f"- no difference beyond rounding: {', '.join(others)}."
    yield ""


def _stepped(cells: Iterable[CellEntry], axis: str, release: str) -> set[str]:
    """Return the environments that a release was stepped from states in."""
    of_release = [cell for cell in cells if cell.axes.get(axis) == release]
    return {str(case.env) for cell in of_release for case in cell.cases if case.behaviour}


if __name__ == "__main__":
    main()

"""What `run` and `try` do with their records: a report folder, a table on the terminal, an exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness import document, machine, present, store, tables, verdict
from harness.model import CellRecord, Plan, Verdict
from harness.store import Store

FAIL_ON = ("unexpected", "stale", "inconclusive", "unavailable", "not_run")
DEFAULT_FAIL_ON = ("unexpected", "stale")


@dataclass(frozen=True, kw_only=True, slots=True)
class Wanted:
    """How the user wants the report."""

    out: Path | None
    pivot: tuple[str, str] | None
    json: bool
    fail_on: tuple[str, ...]

    @classmethod
    def of(cls, args: argparse.Namespace) -> Wanted:
        """From the command line of `run`."""
        return cls(out=args.out, pivot=tuple(args.pivot) if args.pivot else None, json=args.json, fail_on=args.fail_on)


def kinds(text: str) -> tuple[str, ...]:
    """The value of `--fail-on`."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [name for name in names if name not in FAIL_ON]
    if unknown:
        message = f"{unknown[0]!r} is none of {', '.join(FAIL_ON)}"
        raise argparse.ArgumentTypeError(message)
    return names


def headline(record: CellRecord) -> str:
    """One line about a finished cell, for the progress."""
    judged = verdict.judge(record)
    told = f" in {judged.phase}" if judged.phase and judged.verdict is not Verdict.UNAVAILABLE else ""
    note = " (reused)" if record.reused else f" ({record.seconds:.1f} s)"
    return f"{judged.verdict}{told}{note}"


def finish(plans: Sequence[Plan], records: Iterable[CellRecord], opened: Store, wanted: Wanted) -> int:
    """Write the report of each matrix, print the table, and return the exit code of all."""
    measured = {record.cell.id: record for record in records}
    here = machine.facts()
    documents = []
    for plan in plans:
        folder = wanted.out or opened.folder / "reports" / plan.matrix
        if wanted.out and len(plans) > 1:
            folder = wanted.out / plan.matrix
        known = [found for cell in plan.cells if (found := measured.get(cell.id) or _kept(opened, here.id, cell))]
        made = document.build(known, [plan], {here.id: here.facts}, store.now())
        documents.append((folder, write(made, folder, opened, wanted)))
    whole = document.combined([made for _, made in documents])
    if wanted.json:
        sys.stdout.buffer.write(document.encode(document.moved(whole, _from_here(documents[0][0]))))
    else:
        present.print_terminal(tables.report(whole, wanted.pivot))
        print(_closing(whole))
        for folder, _ in documents:
            print(f"report: {_shown(folder)}")
    return document.exit_code(whole, wanted.fail_on)

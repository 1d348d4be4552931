"""`simmatrix lock MATRIX`: resolve every cell to hash-pinned requirements."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from harness.commands import arguments
from harness.commands.select_cells import select
from harness.judging.assess import assess
from harness.machine import store
from harness.machine.console import tell
from harness.machine.files import given_files
from harness.model import CellRecord, Phase, Verdict
from harness.model.report_types import UNTOLD
from harness.reports import publishing
from harness.reports.answers import misspelt
from harness.reports.text import progress
from harness.running import open_matrix, resolving, scheduler
from harness.standalone.output import print_json

HELP = (
    "Resolve every combination of a matrix to hash-pinned requirements. The lock of a single combination is printed, or"
    " written to a file with --out."
)


class LockedCell(msgspec.Struct, frozen=True, kw_only=True):
    """One cell as `lock --json` lists it; `lock` is a path, or null with the reason in `decisive`."""

    id: str
    python: str | None
    lock: str | None
    lock_sha256: str | None
    decisive: str | None


class Locked(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `lock --json`."""

    schema: int = 1
    matrix: str
    cells: tuple[LockedCell, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `lock`."""
    arguments.matrix(parser)
    parser.add_argument("-k", metavar="GLOB", help="only combinations whose id matches")
    arguments.jobs(parser)
    parser.add_argument(
        "--upgrade", action="store_true", help="expand ranges and choose combinations again, with the releases of today"
    )
    parser.add_argument("--offline", action="store_true", help="never ask the package index")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write the lock of a single combination to this file (default: stdout)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Lock the cells. Return 0, or 1 if one unexpectedly has no lock, or 3 if that could not be decided."""
    settings = scheduler.Settings(jobs=args.jobs, until=Phase.RESOLVE, offline=args.offline)
    opened = store.open_store()
    # Only `lock` asks: it chooses the combinations of a covering strategy, which all other verbs read.
    ask = resolving.asking(opened, settings)
    planned = open_matrix.load(args.matrix, tell, offline=args.offline, renew=args.upgrade, ask=ask)
    plan = open_matrix.set_instant(planned, opened, renew=args.upgrade, offline=args.offline)
    cells = select(plan.cells, args.k)
    misspelt.check_cells(cells, tell, offline=args.offline)
    with progress.Progress(len(cells), args.jobs, headline) as board:
        records = scheduler.run(cells, opened, settings, board)
    if args.json:
        print_json(msgspec.json.encode(_document(plan.matrix, records, opened)))
    elif len(records) == 1 and records[0].lock:
        _single((opened.folder / records[0].lock).read_text(), args.out)
    else:
        for record in records:
            print(f"{record.cell.id}  {record.lock or assess(record).decisive}")
    unexpected = [assess(record).verdict for record in records if not record.lock and not _expects_no_lock(record)]
    return 0 if not unexpected else 3 if set(unexpected) <= UNTOLD else 1


def headline(record: CellRecord) -> str:
    """Return in a word how the locking of a cell ended."""
    return "locked" if record.lock else assess(record).verdict.value


def _expects_no_lock(record: CellRecord) -> bool:
    """Return whether the matrix expects that the cell has no lock."""
    expect = record.cell.expect
    return expect is not None and expect.verdict in {Verdict.UNRESOLVABLE, Verdict.UNINSTALLABLE}


def _single(text: str, out: Path | None) -> None:
    if out is None:
        sys.stdout.write(text)
    else:
        given_files.write_text(out, text)


def _document(matrix: str, records: tuple[CellRecord, ...], opened: store.Store) -> Locked:
    locate = publishing.seen_from_here(opened.folder)
    return Locked(
        matrix=matrix,
        cells=tuple(
            LockedCell(
                id=record.cell.id,
                python=record.python,
                lock=locate(record.lock) if record.lock else None,
                lock_sha256=record.lock_sha256,
                decisive=None if record.lock else assess(record).decisive,
            )
            for record in records
        ),
    )

"""`simmatrix run MATRIX...`: lock, build, install, probe and report every cell."""

from __future__ import annotations

import argparse
from fnmatch import fnmatchcase
from pathlib import Path

from harness import catalog, scheduler, store
from harness.commands import progress, reporting
from harness.errors import BadInput
from harness.model import CASE_PHASES, Cell, Phase

HELP = "Lock, build, install, probe and report every cell of one or more matrices; what was measured before is reused."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `run`."""
    parser.add_argument("matrices", metavar="MATRIX", nargs="+", help="a matrix file, or the name of a built-in one")
    parser.add_argument("-j", "--jobs", type=_jobs, default=scheduler.default_jobs(), help="cells at a time [cores]")
    parser.add_argument("-k", metavar="GLOB", help="only cells whose id matches, e.g. '*mujoco3*'")
    parser.add_argument("--until", type=Phase, choices=UNTIL, default=Phase.RENDER, help="stop after this phase")
    parser.add_argument("--fresh", action="store_true", help="measure everything again")
    parser.add_argument("--offline", action="store_true", help="use what is in the caches, never the network")
    parser.add_argument("--verify", action="store_true", help="one process per check, and each failure confirmed")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where the report goes [.harness/reports/MATRIX]")
    parser.add_argument(
        "--fail-on",
        type=reporting.kinds,
        default=reporting.DEFAULT_FAIL_ON,
        metavar="KINDS",
        help=f"comma-separated, of {', '.join(reporting.FAIL_ON)} [%(default)s]",
    )
    parser.add_argument("--pivot", nargs=2, metavar="AXIS", help="the two axes of the table")
    parser.add_argument("--json", action="store_true", help="print the report document, and nothing else, on stdout")


UNTIL = (Phase.RESOLVE, Phase.INSTALL, *CASE_PHASES)


def main(args: argparse.Namespace) -> int:
    """Run the matrices; the exit code is that of the contract."""
    settings = scheduler.Settings(
        jobs=args.jobs, until=args.until, fresh=args.fresh, offline=args.offline, verify=args.verify
    )
    opened = store.open_store()
    plans = [catalog.plan(name, opened, offline=args.offline) for name in args.matrices]
    chosen = [cell for plan in plans for cell in plan.cells if args.k is None or matches(cell, args.k)]
    if not chosen:
        message = f"-k {args.k}: no cell of {', '.join(args.matrices)} matches"
        raise BadInput(message)
    with progress.Progress(len(chosen), settings.jobs, reporting.headline) as board:
        records = scheduler.run(chosen, opened, settings, board)
    return reporting.finish(plans, records, opened, reporting.Wanted.of(args))


def matches(cell: Cell, pattern: str) -> bool:
    """Whether a glob selects a cell, by its whole id, its label or any part of it."""
    return any(fnmatchcase(text, pattern) for text in (cell.id, cell.label)) or pattern in cell.id


def _jobs(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        message = f"{text!r} is not a number of cells at a time"
        raise argparse.ArgumentTypeError(message)
    return int(text)

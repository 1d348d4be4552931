"""`simmatrix repair CELL | REQUIREMENT...`: find the smallest change that turns a red cell green; a rerun proves it."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from harness.commands import ad_hoc_cell, arguments, find_cell
from harness.machine import store
from harness.machine.store import Store
from harness.model import Cell, CellRecord, replace
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.reports.text import progress
from harness.rootcause import search_documents
from harness.rootcause.bench import Bounds
from harness.rootcause.repair import proofs, repair_text
from harness.rootcause.repair import repair_all as repairs
from harness.rootcause.repair.lab import Lab
from harness.rootcause.repair.proofs import RepairDocument
from harness.rootcause.repair.repairing import RepairResult, Search, Status
from harness.running import open_matrix, scheduler
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Find the smallest change that makes a combination work, and verify it by a new measurement. Name a combination of"
    " a matrix by its id, or describe one with the requirements and options of `simmatrix try`. Known fixes are tried"
    " first, then earlier releases."
)
CODES = {Status.FOUND: 0, Status.GREEN: 0, Status.NOT_FOUND: 1, Status.STOPPED: 1, Status.UNTOLD: 3}
RUNS, MINUTES = 40, 15.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `repair`."""
    ad_hoc_cell.add_arguments(parser)
    add_bounds(parser)
    arguments.offline(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write lock and proof to this folder (default: .harness/repairs/CELL)"
    )
    parser.add_argument("--json", action="store_true", help="print the proof as JSON on stdout, and nothing else")


def add_bounds(parser: argparse.ArgumentParser) -> None:
    """Add the options that limit the search: `--runs` and `--minutes`."""
    runs, minutes = (
        "measure at most N combinations (default: %(default)s)",
        "stop after M minutes (default: %(default)g)",
    )
    parser.add_argument("--runs", type=_positive, default=RUNS, metavar="N", help=runs)
    parser.add_argument("--minutes", type=float, default=MINUTES, metavar="M", help=minutes)


def _positive(text: str) -> int:
    if not text.isdigit() or not int(text):
        message = f"{text!r} is not a number of combinations; write one such as 40"
        raise argparse.ArgumentTypeError(message)
    return int(text)


def main(args: argparse.Namespace) -> int:
    """Search for a remedy, write lock and proof, and return the exit code of the status (`CODES`)."""
    if not (args.requirements or args.files or args.subject):
        message = "repair: name a combination, such as 'quickstart/py3.11_*', or requirements, such as 'gym==0.26.2'"
        raise BadInput(message)
    named = _names_cell(args)
    given = None if named else ad_hoc_cell.read(args)
    if args.out:
        store.writable(args.out)
    opened = store.open_store()
    settings = scheduler.Settings(offline=args.offline)
    bounds = Bounds(runs=args.runs, minutes=args.minutes)
    with progress.SearchProgress(args.runs, args.minutes) as board:
        if given is None:
            base = find_cell.find("repair", args.requirements[0], opened, offline=args.offline)[1]
        else:
            runner = scheduler.Runner(opened, settings, board)
            (base,) = ad_hoc_cell.plan_cell(args, given, opened, runner).cells
        document, repaired = repair(base, opened, settings, bounds, board, command=_typed(base))
    document = write(document, repaired, args.out or _folder(opened, base))
    if args.json:
        print_json(search_documents.as_json(document))
    else:
        print("\n".join(_wrapped(repair_text.lines(document), wrapping.width(sys.stdout))))
    return CODES[document.status]


def _wrapped(lines: Iterable[str], columns: int | None) -> Iterator[str]:
    """Yield lines broken at the width of a terminal; commands, files and quoted lines of an error stay whole."""
    for line in lines:
        yield from [line] if line.startswith((" ", "written: ")) else wrapping.wrap(line, columns)


def _names_cell(args: argparse.Namespace) -> bool:
    """Return whether the one word on the command line is a cell, not a requirement."""
    # A direct reference, `name @ https://...`, has slashes, too.
    word = args.requirements[0] if len(args.requirements) == 1 and not (args.files or args.subject) else ""
    return "/" in word and " @ " not in word


def _typed(base: Cell) -> str:
    """Return the command line as it was typed; `simmatrix repair CELL` if it was another verb."""
    words = sys.argv[1:]
    return shlex.join(["simmatrix", *(words if words[:1] == ["repair"] else ["repair", base.id])])


def repair(
    base: Cell, opened: Store, settings: scheduler.Settings, bounds: Bounds, board: scheduler.Observer, *, command: str
) -> tuple[RepairDocument, RepairResult]:
    """Search for a remedy of one cell. Store the records of the cell and of the remedy."""
    with _lab(base, opened, settings, bounds, board) as lab:
        repaired = Search(lab).run()
        for trial in filter(None, (repaired.before, repaired.proof)):
            opened.save_cell(trial.record)
        return proofs.document(lab, repaired, command), repaired


def repair_all(
    records: Sequence[CellRecord], opened: Store, settings: scheduler.Settings, board: scheduler.Observer
) -> tuple[CellRecord, ...]:
    """Search for a remedy of every red cell, once per cause. Write the proofs, return the records of cured cells."""
    # This very run has just measured the cells, so its results are reused, also under --fresh and --only-failed.
    settings, bounds = replace(settings, fresh=False, again=False), Bounds(runs=RUNS, minutes=MINUTES)
    cured = []
    for ended in repairs.repair_every(records, opened, lambda cell: _lab(cell, opened, settings, bounds, board)):
        document = proofs.document(ended.lab, ended.repaired, shlex.join(["simmatrix", "repair", ended.cell.id]))
        document = write(document, ended.repaired, _folder(opened, ended.cell))
        does = "; ".join(document.remedy.does) if document.remedy else ""
        board.say(f"{ended.cell.id}: {document.status}{f': {does}' if does else ''}")
        if ended.cured:
            opened.save_cell(ended.cured)
            cured.append(ended.cured)
    return tuple(cured)


def _lab(base: Cell, opened: Store, settings: scheduler.Settings, bounds: Bounds, board: scheduler.Observer) -> Lab:
    return Lab(
        base=base,
        store=opened,
        settings=settings,
        observer=board,
        bounds=bounds,
        recipes=open_matrix.recipes(Path("matrices")) | open_matrix.recipes(Path()),
    )


def _folder(opened: Store, base: Cell) -> Path:
    return opened.folder / "repairs" / CellId.parse(base.id).folder()


def write(document: RepairDocument, repaired: RepairResult, folder: Path) -> RepairDocument:
    """Write lock and proof into a folder. Return the document with the paths of these files."""
    if document.status in {Status.GREEN, Status.UNTOLD}:
        return document
    locks = {"lock.txt": repaired.proof.lock} if repaired.proof and repaired.proof.lock else {}
    document = msgspec.structs.replace(document, lock=next(iter(locks), None))
    return search_documents.write(document, folder / "repair", locks, repair_text.page)

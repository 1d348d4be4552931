"""`simmatrix accept MATRIX -k GLOB --reason TEXT`: write expectations for cells that are red now."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from harness.commands import arguments, report
from harness.commands.select_cells import choose
from harness.machine import store, this_machine
from harness.machine.console import tell
from harness.machine.files import given_files
from harness.matrix import matrix_file
from harness.model import Cell, Plan
from harness.model.errors import BadInput, HarnessError
from harness.model.report_types import UNTOLD, CellEntry, format_count
from harness.model.vocabulary import Instant
from harness.reports import document, expectation_writer
from harness.running import open_matrix
from harness.running.signatures import shipped_signatures

HELP = (
    "Write an expectation for each combination that fails now into the matrix file, with your reason. From then on,"
    " only another result is reported as unexpected."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `accept`."""
    arguments.matrix(parser)
    parser.add_argument("-k", metavar="GLOB", required=True, help="combinations whose id matches, such as '*mujoco-4*'")
    parser.add_argument("--reason", metavar="TEXT", required=True, type=_reason, help="why they fail")
    parser.add_argument(
        "--until",
        metavar="DATE",
        type=_until,
        help="day after which the expectation is out of date, such as 2027-01-31 (default: never)",
    )
    parser.add_argument("--link", metavar="URL", help="a page about the failure")
    parser.add_argument(
        "--report", metavar="SOURCE", help="a report.json or its folder (default: results of this machine)"
    )
    parser.add_argument("--dry-run", action="store_true", help="print the expectations, and write nothing")


def main(args: argparse.Namespace) -> int:
    """Write the expectations. Return 0, or 1 if no single expectation fits the results of some red cell."""
    path = _editable(args.matrix)
    plan = open_matrix.load(args.matrix, tell, offline=True)
    chosen = choose(plan.cells, args.k)
    entries = _read_entries(args.report, plan) if args.report else _load_entries(plan)
    today = store.now()
    reds, mixed = expectation_writer.reds(chosen, entries, today)
    for sentence in mixed:
        tell(sentence)
    if not reds:
        tell(f"nothing to accept: {_standing(chosen, entries)}")
        return 1 if mixed else 0
    text = given_files.read_content(path).decode()
    wish = expectation_writer.Wish(pattern=args.k, reason=args.reason, link=args.link, until=args.until)
    rewrite = expectation_writer.accept(text, matrix_file.read(text, str(path)), plan.cells, reds, wish)
    print("\n".join(rewrite.tables), end="")
    for sentence in rewrite.replaced:
        tell(sentence)
    if args.dry_run:
        tell(f"nothing was written: {format_count(len(rewrite.tables), 'table')} for {format_count(len(reds), 'cell')}")
        return 1 if mixed else 0
    store.write_atomic(path, rewrite.text.encode())
    try:
        _check(args.matrix, plan, [red.cell.id for red in reds], entries, today)
    except BaseException:
        # An interrupt, too, must not leave a matrix file whose new tables were not checked.
        store.write_atomic(path, text.encode())
        raise
    tell(f"{args.matrix}: {format_count(len(reds), 'cell')} accepted with {format_count(len(rewrite.tables), 'table')}")
    return 1 if mixed else 0


def _check(name: str, plan: Plan, accepted: Sequence[str], entries: dict[str, list[CellEntry]], today: str) -> None:
    """Read the file again. Raise HarnessError unless every accepted cell is as expected and nothing else changed."""

    def judged(cell: Cell) -> list[Any]:
        return [expectation_writer.as_expected(cell, entry, today) for entry in entries[cell.id]]

    after = open_matrix.load(name, lambda _: None, offline=True)
    wrong = expectation_writer.trouble(plan.cells, after.cells, accepted, judged)
    if wrong or len(after.stale) > len(plan.stale):
        message = (
            f"{name}: was put back, since these tables would be wrong: {wrong or after.stale[-1]}; please report it"
        )
        raise HarnessError(message)


# --- what was measured -----------------------------------------------------------------------------------------


def _load_entries(plan: Plan) -> dict[str, list[CellEntry]]:
    """Return the last results of this machine by cell id. Raises BadInput if there are none."""
    opened = store.open_store()
    dated = open_matrix.set_instant(plan, opened)
    here = this_machine.facts()
    records = [record for cell in dated.cells if (record := opened.load_current(here.id, cell))]
    if not records:
        message = (
            f"{plan.matrix}: no results on this machine; run `simmatrix run` first, or name a report.json with --report"
        )
        raise BadInput(message)
    causes = shipped_signatures.load_knowledge(opened.folder)
    return _by_id(document.build(records, [dated], {here.id: here.facts}, store.now(), knowledge=causes).cells)


def _read_entries(source: str, plan: Plan) -> dict[str, list[CellEntry]]:
    """Return the results of a report by cell id. Raises BadInput if its cells differ from the matrix as it is now."""
    path = report.locate(source)
    source_report = document.read_file(path)
    planned = {cell.id: cell for cell in plan.cells}
    entries = [entry for entry in source_report.cells if entry.id in planned]
    mark = document.marks()
    for entry in entries:
        cell = planned[entry.id]
        # An id is not enough: after a change of the matrix it may belong to a cell that asks for something else.
        identity = (dict(cell.axes), cell.python, dict(cell.environment), mark(cell))
        if identity != (entry.axes, entry.requested_python, entry.environment, entry.asked):
            message = f"{path}: {entry.id} has changed in the matrix since; measure it again"
            raise BadInput(message)
    if not entries:
        message = f"{path}: has no cell of {plan.matrix}"
        raise BadInput(message)
    return _by_id(entries)


def _by_id(entries: Sequence[CellEntry]) -> dict[str, list[CellEntry]]:
    groups: dict[str, list[CellEntry]] = {}
    for entry in entries:
        groups.setdefault(entry.id, []).append(entry)
    return groups


def _standing(chosen: Sequence[Cell], entries: dict[str, list[CellEntry]]) -> str:
    decided_count = sum(any(entry.verdict not in UNTOLD for entry in entries.get(cell.id, ())) for cell in chosen)
    untold = len(chosen) - decided_count
    rest = f"; {format_count(untold, 'combination')} without a result" if untold else ""
    verb = "works or fails" if decided_count == 1 else "work or fail"
    return f"{format_count(decided_count, 'combination')} {verb} as expected{rest}"


# --- what the user gave ----------------------------------------------------------------------------------------


def _editable(name: str) -> Path:
    """Return the path of a matrix file. Raises BadInput for a matrix that belongs to the installed package."""
    path = open_matrix.locate(name).resolve()
    if path.is_relative_to((open_matrix.PACKAGE / "matrices").resolve()):
        message = f"{name}: belongs to the installed simmatrix; copy it and accept in the copy: cp {path} {path.name}"
        raise BadInput(message)
    return path


def _reason(text: str) -> str:
    if not text.strip():
        message = "give the reason why these combinations fail"
        raise argparse.ArgumentTypeError(message)
    return text.strip()


def _until(text: str) -> str:
    """Return the value of `--until` as it was typed. Raises ArgumentTypeError if it is no date or has passed."""
    try:
        instant = Instant.canonical(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    if instant < store.now():
        message = f"{text} has passed already; name a later day"
        raise argparse.ArgumentTypeError(message)
    return text

"""`simmatrix plan MATRIX`: list the cells of a matrix, and the combinations left out, each with its reason."""

from __future__ import annotations

import argparse

import msgspec

from harness.commands.select_cells import choose
from harness.machine.console import tell
from harness.model import Cell, Dropped, Plan
from harness.model.report_types import format_count
from harness.reports.answers import misspelt
from harness.running import open_matrix
from harness.standalone.output import print_json

HELP = (
    "List the combinations of a matrix with their environments, and those left out, each with its reason. Nothing is"
    " installed."
)


class PlannedCell(msgspec.Struct, frozen=True, kw_only=True):
    """One cell as `plan --json` lists it."""

    id: str
    axes: dict[str, str]
    requirements: tuple[str, ...]
    environment: dict[str, str]
    cases: tuple[str, ...]
    expected: str


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `plan --json`."""

    schema: int = 1
    matrix: str
    cells: tuple[PlannedCell, ...]
    dropped: tuple[Dropped, ...]
    stale: tuple[str, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `plan`."""
    parser.add_argument("matrix", metavar="MATRIX", help="a matrix file, or the name of a built-in matrix")
    parser.add_argument("-k", metavar="GLOB", help="only combinations whose id matches")
    parser.add_argument("--offline", action="store_true", help="never ask the package index")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Print the plan."""
    plan = open_matrix.load(args.matrix, tell, offline=args.offline)
    # Not `select`, which refuses a matrix without cells: this verb lists why there are none.
    cells = choose(plan.cells, args.k)
    misspelt.check_cells(cells, tell, offline=args.offline)
    if args.json:
        print_json(msgspec.json.encode(_document(plan, cells)))
        return 0
    for cell in cells:
        expected = f"  [{cell.expect.verdict}]" if cell.expect else ""
        print(f"{cell.id}  {', '.join(case.id for case in cell.cases)}{expected}")
    for dropped in plan.dropped:
        several = f" ({format_count(dropped.count, 'combination')})" if dropped.count > 1 else ""
        print(f"left out: {dropped.id}{several}: {dropped.reason}")
    for sentence in plan.stale:
        print(f"out of date: {sentence}")
    gone = sum(dropped.count for dropped in plan.dropped)
    print(f"{format_count(len(cells), 'combination')}, {gone or 'none'} left out")
    return 0


def _document(plan: Plan, cells: tuple[Cell, ...]) -> Planned:
    return Planned(
        matrix=plan.matrix,
        cells=tuple(
            PlannedCell(
                id=cell.id,
                axes=dict(cell.axes),
                requirements=cell.question.requirements,
                environment=dict(cell.environment),
                cases=tuple(case.id for case in cell.cases),
                expected=cell.expect.verdict if cell.expect else "works",
            )
            for cell in cells
        ),
        dropped=plan.dropped,
        stale=plan.stale,
    )

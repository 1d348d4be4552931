"""`simmatrix run MATRIX...`: lock, build, install, probe and report every cell."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from harness.commands import arguments, select_cells
from harness.machine import store
from harness.machine.console import tell
from harness.model import CASE_PHASES, Cell, Phase, Plan
from harness.model.errors import BadInput
from harness.model.report_types import format_count
from harness.reports.answers import misspelt
from harness.running import open_matrix, shards

if TYPE_CHECKING:
    from harness.running.offline.offline_bundle import Fetched

HELP = (
    "Measure every combination of one or more matrices: lock, build, install, test and report. Earlier results are"
    " reused. A run that was interrupted continues where it stopped. The report is written to"
    " .harness/reports/MATRIX."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    parser.add_argument("matrices", metavar="MATRIX", nargs="+", help="a matrix file, or the name of a built-in matrix")
    arguments.jobs(parser)
    parser.add_argument("-k", metavar="GLOB", help="only combinations whose id matches, such as '*mujoco-3*'")
    arguments.shard(parser)
    arguments.durations(parser)
    parser.add_argument("--only-failed", action="store_true",
                        help="measure again only what failed or was inconclusive here the last time")  # fmt: skip
    parser.add_argument("--until", choices=UNTIL, default=UNTIL[-1], metavar="PHASE",
                        help=f"stop after this phase: {', '.join(UNTIL)} (default: {UNTIL[-1]})")  # fmt: skip
    parser.add_argument("--fresh", action="store_true", help="ignore earlier results; locks are kept")
    arguments.offline(parser)
    parser.add_argument(
        "--fetched",
        type=Path,
        metavar="DIR",
        help="measure from a folder that `simmatrix fetch` wrote, without network",
    )
    arguments.verify(parser)
    parser.add_argument("--prove", action="store_true",
                        help="then measure failed combinations again, with fixes of their known issues")  # fmt: skip
    parser.add_argument("--repair", action="store_true",
                        help="then search for a fix of each failed combination, once per cause")  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write the report to this folder (default: .harness/reports/MATRIX)"
    )
    arguments.fail_on(parser)
    parser.add_argument("--pivot", nargs=2, metavar="AXIS", help="the two axes of the table: rows, columns")
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout, and nothing else")


UNTIL = tuple(phase.value for phase in (Phase.RESOLVE, Phase.INSTALL, *CASE_PHASES, Phase.SUITE))


def main(args: argparse.Namespace) -> int:
    """Run the matrices and publish their reports. Return the exit code, which depends on `--fail-on`."""
    layer = _open_fetched(args.fetched) if args.fetched else None
    offline = args.offline or layer is not None
    if (args.prove or args.repair) and layer:
        option = "--prove" if args.prove else "--repair"
        message = f"{option}: the packages of a fix are not in a folder of `fetch`; leave --fetched out"
        raise BadInput(message)
    planned = [open_matrix.load(name, tell, offline=offline, fetched=layer) for name in args.matrices]
    # Mistakes are looked for before the store is opened: bad input leaves no result behind.
    select_cells.check_distinct(planned)
    cells = select_cells.select([cell for plan in planned for cell in plan.cells], args.k)
    if layer is None:
        misspelt.check_cells(cells, tell, offline=offline)
    if args.pivot:
        from harness.reports.tables import tables  # noqa: PLC0415 - start-up

        tables.check_pivot(args.pivot, [plan.axes for plan in planned])
    if args.out:
        store.writable(args.out)
    opened = store.open_store()
    plans = [open_matrix.set_instant(plan, opened, fetched=layer, offline=offline) for plan in planned]
    chosen = _chosen(args, plans, opened, layer)
    # What runs cells is imported once the store has been asked: input that is refused does not wait for it.
    from harness.commands import measure_plans  # noqa: PLC0415 - start-up

    return measure_plans.measure(args, plans, chosen, opened, layer)


def _open_fetched(folder: Path) -> Fetched:
    from harness.running.offline import offline_bundle  # noqa: PLC0415 - start-up

    return offline_bundle.open_folder(folder)


def _chosen(
    args: argparse.Namespace, plans: Sequence[Plan], opened: store.Store, layer: Fetched | None
) -> tuple[Cell, ...]:
    """Return the cells to run, after -k, --shard and --only-failed. A shard, or the failed cells, may be none."""
    cells = select_cells.select([cell for plan in plans for cell in plan.cells], args.k)
    if args.shard:
        seconds = layer.seconds() if layer else select_cells.committed_seconds(args.matrices, plans)
        seconds |= select_cells.durations(args.durations)
        whole, cells = len(cells), shards.split(cells, args.shard.count, seconds)[args.shard.number - 1]
        tell(f"shard {args.shard}: {len(cells)} of {format_count(whole, 'cell')}")
    if args.only_failed:
        cells = select_cells.select_failed(cells, opened)
        if not cells:
            tell("nothing to do: no combination failed or was inconclusive the last time")
    return cells

"""`simmatrix run MATRIX...`: lock, build, install, probe and report every cell."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from harness.commands import arguments, select_cells
from harness.machine import store
from harness.machine.console import tell
from harness.model import CASE_PHASES, Cell, CellRecord, Phase, Plan
from harness.model.errors import BadInput, HarnessError
from harness.model.report_types import format_count
from harness.reports.answers import misspelt
from harness.reports.text import progress
from harness.running import open_matrix, remedy_trials, scheduler, shards
from harness.running.signatures import shipped_signatures

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
    settings = scheduler.Settings(
        jobs=args.jobs,
        until=Phase(args.until),
        fresh=args.fresh,
        again=args.only_failed,
        offline=args.offline or layer is not None,
        verify=args.verify,
        fetched=layer,
    )
    if (args.prove or args.repair) and layer:
        option = "--prove" if args.prove else "--repair"
        message = f"{option}: the packages of a fix are not in a folder of `fetch`; leave --fetched out"
        raise BadInput(message)
    planned = [open_matrix.load(name, tell, offline=settings.offline, fetched=layer) for name in args.matrices]
    # Mistakes are looked for before the store is opened: bad input leaves no result behind.
    select_cells.check_distinct(planned)
    cells = select_cells.select([cell for plan in planned for cell in plan.cells], args.k)
    if layer is None:
        misspelt.check_cells(cells, tell, offline=settings.offline)
    if args.pivot:
        from harness.reports.tables import tables  # noqa: PLC0415 - start-up

        tables.check_pivot(args.pivot, [plan.axes for plan in planned])
    if args.out:
        store.writable(args.out)
    opened = store.open_store()
    plans = [open_matrix.set_instant(plan, opened, fetched=layer, offline=settings.offline) for plan in planned]
    chosen = _chosen(args, plans, opened, layer)
    earlier = partial(_earlier_seconds, args.matrices, plans, chosen, opened)
    with progress.Progress(len(chosen), settings.jobs, progress.headline, earlier) as board:
        records = scheduler.run(chosen, opened, settings, board, _load_report)
    if args.prove:
        plans, more = _run_remedies(plans, records, opened, settings)
        records = (*records, *more)
    if args.repair:
        plans, more = _run_repairs(plans, records, opened, settings)
        records = (*records, *more)
    from harness.reports import publishing  # noqa: PLC0415 - start-up: the report comes after the last cell

    return publishing.finish(plans, records, opened, publishing.Wanted.of(args))


def _load_report() -> None:
    """Import what makes the report, which takes a while."""
    from harness.reports import publishing  # noqa: PLC0415 - start-up

    publishing.load()


def _open_fetched(folder: Path) -> Fetched:
    from harness.running.offline import offline_bundle  # noqa: PLC0415 - start-up

    return offline_bundle.open_folder(folder)


def _run_remedies(
    plans: Sequence[Plan], records: Sequence[CellRecord], opened: store.Store, settings: scheduler.Settings
) -> tuple[list[Plan], tuple[CellRecord, ...]]:
    """Run red cells again with the remedies of known failures. Return the plans with these cells, and their records."""

    from harness.judging.assess import assess  # noqa: PLC0415 - start-up

    knowledge, recipes = shipped_signatures.load_knowledge(opened.folder), partial(open_matrix.recipes, Path())
    assessed = {plan.matrix: [assess(record, knowledge) for record in _of(plan, records)] for plan in plans}
    cells = [cell for plan in plans for cell in remedy_trials.make_trials(plan.cells, assessed[plan.matrix], recipes)]
    if not cells:
        tell("no fix of a known issue is left to try")
        return list(plans), ()
    tell(f"{format_count(len(cells), 'failed combination')} to measure again, each with the fix of a known issue")
    with progress.Progress(len(cells), settings.jobs, progress.headline) as board:
        more = scheduler.run(cells, opened, settings, board)
    return [remedy_trials.add(plan, [cell for cell in cells if cell.matrix == plan.matrix]) for plan in plans], more


def _run_repairs(
    plans: Sequence[Plan], records: Sequence[CellRecord], opened: store.Store, settings: scheduler.Settings
) -> tuple[list[Plan], tuple[CellRecord, ...]]:
    """Search for a repair of each red cell. Return the plans with the repaired cells, and their records."""
    from harness.commands import repair  # noqa: PLC0415 - start-up

    with progress.SearchProgress() as board:
        more = repair.repair_all(records, opened, settings, board)
    cells = [record.cell for record in more]
    return [remedy_trials.add(plan, [cell for cell in cells if cell.matrix == plan.matrix]) for plan in plans], more


def _of(plan: Plan, records: Sequence[CellRecord]) -> list[CellRecord]:
    return [record for record in records if record.cell.matrix == plan.matrix]


def _chosen(
    args: argparse.Namespace, plans: Sequence[Plan], opened: store.Store, layer: Fetched | None
) -> tuple[Cell, ...]:
    """Return the cells to run, after -k, --shard and --only-failed. A shard, or the failed cells, may be none."""
    cells = select_cells.select([cell for plan in plans for cell in plan.cells], args.k)
    if args.shard:
        seconds = layer.seconds() if layer else _committed(args.matrices, plans)
        seconds |= select_cells.durations(args.durations)
        whole, cells = len(cells), shards.split(cells, args.shard.count, seconds)[args.shard.number - 1]
        tell(f"shard {args.shard}: {len(cells)} of {format_count(whole, 'cell')}")
    if args.only_failed:
        cells = select_cells.select_failed(cells, opened)
        if not cells:
            tell("nothing to do: no combination failed or was inconclusive the last time")
    return cells


def _earlier_seconds(
    names: Sequence[str], plans: Sequence[Plan], cells: Sequence[Cell], opened: store.Store
) -> dict[str, float]:
    """Return the seconds that cells took before, by id: here, else where the committed report was measured."""
    seconds: dict[str, float] = {}
    with contextlib.suppress(HarnessError):  # a report that cannot be read is no reason to measure nothing
        seconds |= _committed(names, plans)
    seconds |= {record.cell.id: record.seconds for record in opened.cells() if record.seconds}
    return {cell.id: seconds[cell.id] for cell in cells if cell.id in seconds}


def _committed(names: Sequence[str], plans: Sequence[Plan]) -> dict[str, float]:
    """Return the seconds of cells, by id, from the reports that are committed for these matrices."""
    files = (
        select_cells.committed_report(open_matrix.locate(name), plan.matrix)
        for name, plan in zip(names, plans, strict=True)
    )
    return select_cells.durations(file for file in files if file)

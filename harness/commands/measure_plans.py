"""Measure the cells of planned matrices, then what `--prove` and `--repair` add, and publish the reports."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from harness.commands import select_cells
from harness.machine import store
from harness.machine.console import tell
from harness.model import Cell, CellRecord, Phase, Plan
from harness.model.errors import HarnessError
from harness.model.report_types import format_count
from harness.reports.text import progress
from harness.running import open_matrix, remedy_trials, scheduler
from harness.running.signatures import shipped_signatures

if TYPE_CHECKING:
    from harness.running.offline.offline_bundle import Fetched


def measure(
    args: argparse.Namespace, plans: Sequence[Plan], cells: Sequence[Cell], opened: store.Store, layer: Fetched | None
) -> int:
    """Measure the cells as the options of `run` say, and publish the reports of their plans. Return the exit code."""
    settings = scheduler.Settings(
        jobs=args.jobs,
        until=Phase(args.until),
        fresh=args.fresh,
        again=args.only_failed,
        offline=args.offline or layer is not None,
        verify=args.verify,
        fetched=layer,
    )
    earlier = partial(_earlier_seconds, args.matrices, plans, cells, opened)
    with progress.Progress(len(cells), settings.jobs, progress.headline, earlier) as board:
        records = scheduler.run(cells, opened, settings, board, partial(_load_report, plans))
    if args.prove:
        plans, more = _run_remedies(plans, records, opened, settings)
        records = (*records, *more)
    if args.repair:
        plans, more = _run_repairs(plans, records, opened, settings)
        records = (*records, *more)
    from harness.reports import publishing  # noqa: PLC0415 - start-up: the report comes after the last cell

    return publishing.finish(plans, records, opened, publishing.Wanted.of(args))


def _load_report(plans: Sequence[Plan]) -> None:
    """Get ready for the report, which takes a while."""
    from harness.reports import publishing  # noqa: PLC0415 - start-up

    publishing.load(plans)


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


def _earlier_seconds(
    names: Sequence[str], plans: Sequence[Plan], cells: Sequence[Cell], opened: store.Store
) -> dict[str, float]:
    """Return the seconds that cells took before, by id: here, else where the committed report was measured."""
    seconds: dict[str, float] = {}
    with contextlib.suppress(HarnessError):  # a report that cannot be read is no reason to measure nothing
        seconds |= select_cells.committed_seconds(names, plans)
    seconds |= {record.cell.id: record.seconds for record in opened.cells() if record.seconds}
    return {cell.id: seconds[cell.id] for cell in cells if cell.id in seconds}

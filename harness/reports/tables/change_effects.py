"""Compare a cell with the cell that a change made of it."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from harness.judging.expectation import is_fulfilled
from harness.judging.identity import failure
from harness.model import FAILING, Phase
from harness.model.report_types import UNTOLD, CellEntry, DiagnosisEntry
from harness.reports.tables.table_types import Effect


def effect(before: CellEntry, after: CellEntry) -> Effect:
    """Return the effect of a change on a cell: compare the cells before and after it, both on one machine."""
    does = works(before), works(after)
    if any(cell.verdict in UNTOLD and not well for cell, well in zip((before, after), does, strict=True)):
        return Effect.UNTOLD
    if any(does):
        return {(True, True): Effect.NOTHING, (False, True): Effect.CURES}.get(does, Effect.BREAKS)
    first, second = _failed(before), _failed(after)
    if second < first:
        return Effect.PARTLY
    failed = failure(before), failure(after)
    if failed[0] and failed[1] and failed[0].same(failed[1]):
        return Effect.BREAKS if first < second else Effect.NOTHING
    # Another failure: in an earlier phase the change made it, else the first failure may have hidden it.
    order = list(Phase)
    places = [order.index(cell.phase) if cell.phase else len(order) for cell in (before, after)]
    return Effect.BREAKS if places[1] < places[0] else Effect.UNCOVERS


def works(cell: CellEntry) -> bool:
    """Return whether everything that was asked for passed, and no silent issue is left open."""
    return is_fulfilled(cell.verdict, cell.phases, cell.unverified)


def _failed(cell: CellEntry) -> set[tuple[str, str]]:
    """Return the failed checks by case; without any, the failed phases (steps of the host) under an empty case."""
    failed_checks = {(case.case, check) for case in cell.cases for check, how in case.checks.items() if how in FAILING}
    return failed_checks | {("", phase) for phase, how in cell.phases.items() if how in FAILING and not failed_checks}


def mark_proven(cells: Iterable[CellEntry]) -> tuple[CellEntry, ...]:
    """Return the cells with the proven remedies marked.

    A remedy is proven if the cell that it makes of this one was measured on the same machine, too, and works.
    """
    entries = tuple(cells)
    cured = {
        (cell.base, cell.machine, name): cell.id
        for cell in entries
        if cell.change and works(cell)
        for name in cell.change.remedy_of
    }

    def judged(cell: CellEntry, diagnosis: DiagnosisEntry) -> DiagnosisEntry:
        proof = cured.get((cell.id, cell.machine, diagnosis.signature))
        return msgspec.structs.replace(diagnosis, proven=proof is not None, proof=proof)

    return tuple(
        msgspec.structs.replace(cell, diagnoses=tuple(judged(cell, one) for one in cell.diagnoses))
        if cell.diagnoses
        else cell
        for cell in entries
    )

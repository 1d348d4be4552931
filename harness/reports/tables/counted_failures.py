"""Select the known failures that count in a cell of a document, and identify its failure."""

from __future__ import annotations

from collections.abc import Iterator

from harness.judging import identity
from harness.judging.identity import Failure
from harness.model.report_types import CellEntry, DiagnosisEntry
from harness.standalone.failures import counting
from harness.standalone.failures.counting import Fit


def counted(cell: CellEntry) -> tuple[DiagnosisEntry, ...]:
    """Return the known failures that count in a cell, the deepest cause first."""
    return counting.select_counting(_fits(cell))


def nameable(cell: CellEntry) -> tuple[str, ...]:
    """Return the ids of the known failures that an expectation may name."""
    return tuple(one.signature for one in counting.nameable(_fits(cell)))


def failure(cell: CellEntry) -> Failure | None:
    """Return the failure of a cell; None if it works, or if its result says nothing of its packages."""
    return identity.failure(cell, (one.signature for one in counted(cell)))


def collect_reasons(cell: CellEntry) -> list[str]:
    """Return the lines that say why a cell and its checks ended as they did."""
    return [cell.decisive or "", *(line for case in cell.cases for line in case.reasons.values())]


def _fits(cell: CellEntry) -> Iterator[Fit]:
    lines = collect_reasons(cell)
    for diagnosis in cell.diagnoses:
        says = counting.is_stated(diagnosis.seen, lines)
        yield Fit(diagnosis=diagnosis, masks=diagnosis.masks, generic=diagnosis.generic, seen=diagnosis.seen, says=says)

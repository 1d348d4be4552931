"""Load a cell that was measured before.

It comes from the reports of the harness, from those that `HARNESS_RESULTS` names, or from a table without a report.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from harness.model import cellid
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.model.measured import MeasuredCell
from harness.model.report_types import CellEntry, Document
from harness.reports import document, publishing
from harness.reports.answers import result_index, shipped_reports

if TYPE_CHECKING:
    from harness.running import lock_files


def ids(pattern: str) -> list[str]:
    """Return the ids of cells in the reports at hand that an id, a label or a glob names."""
    cells = {cell.id: cell for made, _ in _documents(pattern) for cell in made.cells if cell.measured}
    return sorted(cell.id for cell in cellid.select(pattern, list(cells.values())))


def load(cell: str) -> Document:
    """Return a document of one cell, its paths as seen from the working folder."""
    report, file = next(each for each in _documents(cell) if any(one.id == cell for one in each[0].cells))
    return document.relocate(document.only(report, {cell}), publishing.seen_from_here(file.parent))


def lock_of(cell: str) -> lock_files.MeasuredLock:
    """Return the lock of a measured cell. Raises BadInput where it has none."""
    measured = result_index.load()
    entry = next((one for one in measured.cells if one.id == cell and one.lock), None)
    if entry is None or entry.lock is None:
        message = f"{cell}: has no lock"
        raise BadInput(message)
    from harness.running import lock_files  # noqa: PLC0415 - start-up

    return lock_files.MeasuredLock(
        lock=measured.lock_text(entry.lock),
        cell=cell,
        python=str(entry.python),
        machine=entry.machine,
        measured=entry.measured,
        settings=entry.environment,
    )


def of_table(cell: str) -> MeasuredCell | None:
    """Return a cell of a table, whose lock and evidence were not kept; None if it has a report."""
    return next((one for one in _table_cells() if one.id == cell), None)


def _table_cells() -> Sequence[MeasuredCell]:
    return [one for one in result_index.load_shipped().cells if one.source]


def _documents(pattern: str) -> list[tuple[Document, Path]]:
    """Return the report that an id names, or all of them and the tables, with their files."""
    matrix = CellId.parse(pattern).matrix
    report = shipped_reports.load(matrix) if matrix else None
    if report:
        return [report]
    cells = _table_cells()
    mine = [one for one in cells if one.matrix == matrix]
    return [_as_document(mine)] if mine else [*shipped_reports.load_all(), _as_document(cells)]


def _as_document(cells: Sequence[MeasuredCell]) -> tuple[Document, Path]:
    """Return the cells of tables as a document; it names no files."""
    entries = msgspec.convert(msgspec.to_builtins(cells), tuple[CellEntry, ...])
    generated = max((one.measured for one in cells), default="")
    return Document(generated=generated, machines={}, cells=entries, dropped=()), Path("report.json")

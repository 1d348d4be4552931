"""Load a cell that was measured before.

It comes from the reports of the harness, or from those that `HARNESS_RESULTS` names.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from harness.commands import issuing
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import Store
from harness.model import cellid
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.model.report_types import Document
from harness.reports import document, judge_again, packs, publishing
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


def issue(cell: str) -> str:
    """Return a cell that fails as an issue for the package's maintainers.

    Raises BadInput for one that does not fail, and where the evidence does not lie beside its report, as in our wheel.
    """
    report, file = next(each for each in _documents(cell) if any(one.id == cell for one in each[0].cells))
    entry = next(one for one in report.cells if one.id == cell)
    issuing.refuse_green(entry)
    index = packs.index(file.parent)
    if index is None or not all((file.parent / name).exists() for name in index.packs):
        again = shlex.join(["simmatrix", "run", entry.matrix, "-k", entry.label])
        message = f"show {cell} --issue: its evidence is not here; measure it first: {again}"
        raise BadInput(message)
    with scratch_folder() as state:
        record = judge_again.unpack_record(file.parent, index, cell, Store(state))
        return issuing.issue(record, entry, report.machines.get(entry.machine or "", {}), state)


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


def _documents(pattern: str) -> list[tuple[Document, Path]]:
    """Return the report that an id names, or all of them, with their files."""
    matrix = CellId.parse(pattern).matrix
    report = shipped_reports.load(matrix) if matrix else None
    return [report] if report else list(shipped_reports.load_all())

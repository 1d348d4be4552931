"""Select the cells that a command works on, by a glob or because they failed the last time, and what they took."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from harness.machine import store
from harness.machine.files import given_files
from harness.machine.store import Store
from harness.model import Cell, Plan, Verdict, cellid
from harness.model.errors import BadInput
from harness.running import open_matrix, shards


def committed_report(matrix: Path, name: str) -> Path | None:
    """Return the report committed for a matrix file, if any: in `reports/NAME/` beside it or its `matrices/`."""
    folder = matrix.absolute().parent
    places = [folder.parent] if folder.name == "matrices" else []
    files = (place / "reports" / name / "report.json" for place in (*places, folder))
    return next((file for file in files if file.is_file()), None)


def durations(files: Iterable[Path]) -> dict[str, float]:
    """Return the seconds of cells by id, from report documents. A later document overrides an earlier one."""
    from harness.reports import document  # noqa: PLC0415 - start-up: few runs name a report

    seconds: dict[str, float] = {}
    for file in files:
        content = given_files.read_content(file, f"--durations {file}")
        seconds |= shards.recorded_seconds(document.read(content, str(file)))
    return seconds


def committed_seconds(names: Sequence[str], plans: Sequence[Plan]) -> dict[str, float]:
    """Return the seconds of cells, by id, from the reports that are committed for these matrices."""
    files = (committed_report(open_matrix.locate(name), plan.matrix) for name, plan in zip(names, plans, strict=True))
    return durations(file for file in files if file)


def choose(cells: Sequence[Cell], pattern: str | None) -> tuple[Cell, ...]:
    """Return the cells whose id or label a glob matches. Raises BadInput if there are none."""
    if pattern is None:
        return tuple(cells)
    matches = tuple(cell for cell in cells if cellid.fits(pattern, cell))
    if not matches:
        example = f"; one of them is {cells[0].id}" if cells else ""
        message = f"-k {pattern}: none of the {len(cells)} combinations matches{example}"
        raise BadInput(message)
    return matches


def select(cells: Sequence[Cell], pattern: str | None) -> tuple[Cell, ...]:
    """Return the cells to work on, chosen by a glob. Raises BadInput if there are none."""
    if not cells:
        message = "nothing to do: every combination is left out; `simmatrix plan` gives the reasons"
        raise BadInput(message)
    return choose(cells, pattern)


def check_distinct(plans: Sequence[Plan]) -> None:
    """Refuse two matrices of one name: their cells and reports could not be told apart."""
    names = [plan.matrix for plan in plans]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        message = f"two matrices have the name {twice}; name only one of them, or rename one"
        raise BadInput(message)


def select_failed(cells: Iterable[Cell], opened: Store) -> tuple[Cell, ...]:
    """Return the cells whose last record here is inconclusive or not as expected. Cells that never ran are left out."""
    from harness.machine import this_machine  # noqa: PLC0415 - start-up: few runs ask for the failed cells

    here, today = this_machine.facts().id, store.now()
    return tuple(cell for cell in cells if _failed(cell, opened, here, today))


def _failed(cell: Cell, opened: Store, here: str, today: str) -> bool:
    from harness.judging.assess import assess  # noqa: PLC0415 - start-up
    from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up

    record = opened.load_current(here, cell)
    if record is None:
        return False

    assessment = assess(record, shipped_signatures.load_knowledge(opened.folder), today)
    return assessment.verdict is Verdict.INCONCLUSIVE or assessment.as_expected is False

"""Collect all measured results of a checkout: those of its reports, and of its tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from harness.matrix import signatures
from harness.matrix.signatures import Signature
from harness.model.measured import Measured, MeasuredCell
from harness.reports.answers import digest
from harness.reports.past_results import hand_measured, judged_failures, table_files
from harness.reports.past_results.table_cells import make_cell


def from_checkout(root: Path, reports: Iterable[Path]) -> Measured:
    """Return the measured cells of reports and of the tables of a checkout. Raises BadInput."""
    return digest.combine([digest.from_files(reports), from_tables(root)])


def from_tables(root: Path) -> Measured:
    """Return the measured cells of the tables of a checkout; none if it has no tables. Raises BadInput."""
    texts = {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in table_files.list_files(root)}
    issues = signatures.read({name: text for name, text in texts.items() if name.startswith(table_files.SIGNATURES)})
    cells = tuple(_cells(texts, issues))
    ids = {name for cell in cells for name in cell.causes}
    remedies = {str(one.id): digest.describe_remedy(one.remedy.plain) for one in issues if one.id in ids}
    day = max((cell.measured for cell in cells), default="")
    return digest.with_locks(day, {}, cells, {}, remedies)


def _cells(texts: dict[str, str], issues: tuple[Signature, ...]) -> Iterator[MeasuredCell]:
    if table_files.HAND in texts:
        for row, table in hand_measured.read_rows(texts[table_files.HAND], texts.get(table_files.AGREEMENT, "")):
            yield make_cell(row, table, issues)
    if table_files.JUDGED in texts and table_files.TRUTH in texts:
        page = texts.get(table_files.JUDGED_PAGE, "")
        for row, table in judged_failures.read_rows(texts[table_files.JUDGED], texts[table_files.TRUTH], page):
            yield make_cell(row, table, issues)

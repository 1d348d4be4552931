"""Read the reports that a site is built from. One that cannot be read stops the build before anything is written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.model.report_types import Document
from harness.reports import document
from harness.reports.answers import digest, result_index, shipped_reports
from harness.reports.tables import tables
from harness.reports.tables.table_types import Report


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """A report and its tables. `folder` holds its files; it is None for a table whose evidence was not kept."""

    name: str
    folder: Path | None
    document: Document
    report: Report

    @classmethod
    def of(cls, document: Document, folder: Path | None, name: str) -> Source:
        """Return a report with its tables."""
        return cls(name=name, folder=folder, document=document, report=tables.report(document))


def from_files(files: Sequence[Path]) -> tuple[tuple[Source, ...], Measured]:
    """Return the reports in these files, and their results as one document. Raises BadInput."""
    if not files:
        message = "site: no report was named"
        raise BadInput(message)
    documents = [(document.read_file(file), file) for file in files]
    names = _names(documents)
    sources = [Source.of(content, file.parent, name) for (content, file), name in zip(documents, names, strict=True)]
    measured = digest.combine(digest.from_report(content, file.parent) for content, file in documents)
    return tuple(sources), measured


def shipped() -> tuple[tuple[Source, ...], Measured]:
    """Return the reports that come with the harness, and all results that come with it."""
    documents = list(shipped_reports.load_all())
    names = _names(documents)
    measured = result_index.load_shipped()
    others = result_index.files_of_others()
    if others:
        measured = digest.combine([measured, digest.from_files(others)])
    sources = [Source.of(content, file.parent, name) for (content, file), name in zip(documents, names, strict=True)]
    return tuple(sources), measured


def _names(documents: Sequence[tuple[Document, Path]]) -> list[str]:
    """Return the name of each report: that of its matrix, else of its folder. Raises BadInput for equal names."""
    names = []
    for content, file in documents:
        matrices = list(dict.fromkeys((*content.matrices, *(cell.matrix for cell in content.cells))))
        names.append(matrices or [file.parent.resolve().name])
    counts = Counter(name for each in names for name in each)
    twice = next((name for name, count in counts.items() if count > 1), None)
    if twice is not None:
        places = [str(file) for each, (_, file) in zip(names, documents, strict=True) if twice in each]
        message = f"site: two reports are named {twice}: {places[0]} and {places[1]}; name one of them only"
        raise BadInput(message)
    return [each[0] for each in names]

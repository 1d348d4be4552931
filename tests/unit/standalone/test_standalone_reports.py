"""Measured cells, explained from their texts alone: what works has no cause, what fails has the one that is known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from harness.judging import failure_texts
from harness.judging.known_failures import select_counting
from harness.model import Verdict
from harness.model.report_types import CellEntry
from harness.reports import document
from harness.running.signatures import shipped_signatures
from harness.standalone.explain.explain_text import Explanation, Facts, explain_text
from harness.standalone.failures import matching

ROOT = Path(__file__).parents[3]
ENOUGH = 0.9


@cache
def standalone_signatures() -> tuple[matching.Signature, ...]:
    """Return the known failures as the standalone code reads them."""
    return tuple(matching.read(one.as_file) for one in shipped_signatures.load_all())


def cells() -> Iterator[tuple[Path, CellEntry]]:
    """Yield the cells of all committed reports, with the folder of their report."""
    for path in sorted((ROOT / "reports").glob("*/report.json")):
        yield from ((path.parent, cell) for cell in document.read(path.read_bytes(), str(path)).cells)


def test_logs_of_what_works_have_neither_failure_nor_cause() -> None:
    """The logs of working cells show no failure and no cause, despite notices and warnings in them."""
    count = 0
    for folder, cell in cells():
        if cell.verdict is Verdict.WORKS and cell.evidence:
            for name, text in shipped_signatures.texts(folder / cell.evidence).items():
                if not name.endswith(".jsonl") and text.strip():
                    made = explain_text(text, standalone_signatures())
                    assert (made.failure.decisive, made.cause) == (None, None), (cell.id, name)
                    count += 1
    assert count > 100


def test_texts_of_what_fails_tell_the_causes_that_cells_have() -> None:
    """The texts of failing cells, with the installed packages, mostly give the known cause; otherwise mostly none.

    A cause that is derived from what releases contain is right if the known cause speaks of its package.
    """
    causes = {str(one.id): one.cause.lower() for one in shipped_signatures.load_all()}
    coded = {str(one.id) for one in shipped_signatures.load_all() if one.code}  # a log has no word of our own checks
    right = other = 0
    for folder, cell in cells():
        expected = {one.signature for one in select_counting(cell)} - coded
        text = "\n".join(texts_of(folder, cell))
        if expected and text:
            cause = explain(text, cell).cause
            given = cause.signature.id if cause else ""
            package = given.removeprefix("derived:") if given.startswith("derived:") else ""
            fits = given in expected or bool(package and any(package in causes[name] for name in expected))
            right += fits
            other += not fits
    assert right > 50
    assert right / (right + other) > ENOUGH


def explain(text: str, cell: CellEntry) -> Explanation:
    """Return the explanation of a cell's text."""
    return explain_text(text, standalone_signatures(), Facts(installed=cell.installed, python=cell.python))


def texts_of(folder: Path, cell: CellEntry) -> Iterator[str]:
    """Yield the texts that a cell wrote, and the tracebacks of its replies."""
    if cell.evidence and cell.phase:
        yield from failure_texts.extract_texts(shipped_signatures.texts(folder / cell.evidence), cell.phase)

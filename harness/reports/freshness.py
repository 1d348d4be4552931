"""Reuse a report if making it again would give the same: then it is read, and nothing is written."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import msgspec
from msgspec.structs import replace

from harness.machine import source_digests, store
from harness.machine.files import guarded_files
from harness.machine.this_machine import Machine
from harness.model import CellRecord, Plan, decoding
from harness.model.errors import HarnessError
from harness.model.hostile_data import Unreadable
from harness.model.report_types import Document
from harness.reports import document
from harness.running.signatures import signature_files

FILES = ("report.json", "report.md")
WORDS = "README.md"


class _Note(msgspec.Struct, frozen=True):
    """The mark of a report's inputs, and size and time of change (nanoseconds) of each of its files."""

    mark: str
    files: tuple[tuple[int, int], ...]


MOST = 1 << 20
"""Bytes of a note."""


def mark(plan: Plan, records: Iterable[CellRecord], here: Machine, folder: Path, options: object) -> str:
    """Return a mark of everything that a report is made of.

    It is equal for two reports into one folder, made on one day, exactly if they say the same of what was measured.
    Which results a run has reused is not part of it: `count_reused` writes that.
    """
    # A record's own mark stands for all that its outcomes depend on; the other fields named here are not part of it.
    record_marks = [
        (one.cell.id, one.mark, one.measured, one.seconds, one.controls) if one.mark else (one.cell.id, one)
        for one in records
    ]
    # The folder counts because the paths in a report are relative to it; the day, because expectations end on one.
    return store.digest(
        plan, record_marks, here.id, here.facts, str(folder.absolute()), options, store.now()[:10], stat_sources()
    )


def read(note: Path, made_of: str, folder: Path) -> Document | None:
    """Return the report in a folder if its mark is the same and nobody changed its files since; else None."""
    try:
        noted = guarded_files.read_decoded(note, MOST, decoding.decoder(_Note).decode)
        if noted == _Note(made_of, _files(folder)):
            return document.read_file(folder / FILES[0])
    # Whatever is wrong with the note or the report, the report is made again.
    except (OSError, Unreadable, HarnessError):
        pass
    return None


def count_reused(report: Document, records: Iterable[CellRecord]) -> Document:
    """Return a report that says which of its results this run has reused; the same object if it said so before."""
    reused = {record.cell.id: record.reused for record in records}
    if all(cell.reused == reused.get(cell.id, cell.reused) for cell in report.cells):
        return report
    cells = tuple(replace(cell, reused=reused.get(cell.id, cell.reused)) for cell in report.cells)
    return replace(report, cells=cells)


def keep(note: Path, made_of: str, folder: Path) -> None:
    """Store the mark of the report in a folder, with the state of its files."""
    store.write_atomic(note, msgspec.json.encode(_Note(made_of, _files(folder))))


def _files(folder: Path) -> tuple[tuple[int, int], ...]:
    stats = [(folder / name).stat() for name in (*FILES, *([WORDS] if (folder / WORDS).exists() else []))]
    return tuple((one.st_size, one.st_mtime_ns) for one in stats)


@cache
def stat_sources() -> tuple[tuple[str, int, int], ...]:
    """Return path, size and time of the code and data that make reports: another version makes another report."""
    issues = ((str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in signature_files.files())
    return *source_digests.stat_files(), *issues

"""Whether a report stands as it would be made again: then it is read, and nothing of it is written."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import msgspec

from harness.machine import source_digests, store
from harness.machine.files import given_files, guarded_files
from harness.machine.this_machine import Machine
from harness.model import CellRecord, Plan
from harness.model.errors import HarnessError
from harness.model.hostile_data import Unreadable
from harness.model.report_types import Document
from harness.reports import document, template_files
from harness.running import signature_files

FILES = ("report.json", "report.md")
WORDS = "README.md"


class _Note(msgspec.Struct, frozen=True):
    """What a report was made of, and its files as they were left: size and time of change (nanoseconds)."""

    mark: str
    files: tuple[tuple[int, int], ...]


MOST = 1 << 20
"""Bytes of a note."""


def mark(plan: Plan, records: Iterable[CellRecord], here: Machine, folder: Path, asked: object) -> str:
    """Equal for two reports into one folder, made on one day, exactly when they say the same."""
    told = [
        (one.cell.id, one.mark, one.measured, one.seconds, one.reused, one.controls) if one.mark else (one.cell.id, one)
        for one in records
    ]
    return store.digest(plan, told, here.id, here.facts, str(folder.absolute()), asked, store.now()[:10], _ourselves())


def read(note: Path, made_of: str, folder: Path) -> Document | None:
    """The report in a folder, if it was made of the same and nobody touched it since."""
    try:
        noted = guarded_files.decoded(note, MOST, lambda text: msgspec.json.decode(text, type=_Note))
        if noted == _Note(made_of, _files(folder)):
            return document.read(given_files.read_content(folder / FILES[0]), str(folder / FILES[0]))
    except (OSError, Unreadable, HarnessError):
        pass
    return None


def keep(note: Path, made_of: str, folder: Path) -> None:
    """Note what the report in a folder was made of."""
    store.write_atomic(note, msgspec.json.encode(_Note(made_of, _files(folder))))


def _files(folder: Path) -> tuple[tuple[int, int], ...]:
    found = [(folder / name).stat() for name in (*FILES, *([WORDS] if (folder / WORDS).exists() else []))]
    return tuple((one.st_size, one.st_mtime_ns) for one in found)


@cache
def _ourselves() -> tuple[tuple[int, int], ...]:
    """Return a mark of the code and the data that reports are made with: another version makes another report."""
    return tuple((file.stat().st_size, file.stat().st_mtime_ns) for file in made_with())


def made_with() -> list[Path]:
    """Return every file of ours, since any of them may have a say in a report."""
    package = source_digests.PACKAGE
    data = [*template_files.FOLDER.iterdir(), *(package / "model").glob("*.toml"), *signature_files.files()]
    return sorted([*package.rglob("*.py"), *data])

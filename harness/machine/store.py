"""Keep records, locks and logs: plain JSON files, written atomically, found again by content.

`locks/` and `steps/` hold the answer to each question, `installed/` what became of each lock's install, `cells/` the
last record of each cell on each machine, `evidence/` logs and frames. Probe runs are kept apart (`probes.vault`).
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from time import time
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

from harness.machine.files import guarded_files
from harness.machine.files.cache_path import cache_path
from harness.machine.files.file_locks import exclusive
from harness.model import Cell, CellRecord, Finding, Interpreter, Lock, Outcome, Question, Step, cellid, replace
from harness.model.errors import BadInput
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable

T = TypeVar("T")

REMEMBERED = 16
"""Results of a kind that `load_or_make` keeps: several checkouts share a cache."""

MOST_RECORD, MOST_INSTANT = 256 << 20, 100
"""Bytes that are read of a record, and of an instant."""

NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC


def state_folder() -> Path:
    """Return the folder of results and locks: `HARNESS_STATE`, else `.harness` below the working folder.

    Git ignores it.
    """
    return ignored_by_git(state_path())


def cache_folder() -> Path:
    """Return the folder of environments, wheels and downloads: `HARNESS_CACHE`, else the user's cache folder."""
    return ignored_by_git(cache_path())


def own_folders() -> tuple[Path, ...]:
    """Return the folders of the harness that exist: no probe and no build is to write to them."""
    return tuple(folder for folder in (state_path(), cache_path()) if folder.is_dir())


def state_path() -> Path:
    """Return the path of the folder of results and locks, which need not exist."""
    return Path(os.environ.get("HARNESS_STATE") or ".harness").absolute()


def ignored_by_git(folder: Path) -> Path:
    """Make the folder and let it ignore itself."""
    marker = folder / ".gitignore"
    if not marker.exists():
        write_atomic(writable(folder) / marker.name, b"*\n")
    return folder


def writable(folder: Path) -> Path:
    """Make the folder and return it. Raises BadInput if it cannot be made or written to: the user named a wrong one."""
    trouble = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        trouble = error.strerror
    else:
        trouble = None if os.access(folder, os.W_OK | os.X_OK) else "Permission denied"
    if trouble:
        message = f"{folder}: no folder to write to: {trouble}; name another one"
        raise BadInput(message)
    return folder


def now() -> str:
    """Return this instant, as records write it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def write_atomic(path: Path, content: bytes, *, mode: int = 0o644) -> None:
    """Write the whole file or nothing."""
    temporary = f"{path.parent}/.{os.urandom(8).hex()}.tmp"
    try:
        descriptor = os.open(temporary, NEW, mode)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(temporary, NEW, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        os.replace(temporary, path)  # noqa: PTH105 - thousands of files
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_changed(path: Path, content: bytes, *, mode: int = 0o644) -> None:
    """Write the whole file, unless it says that already."""
    with suppress(Unreadable):
        if guarded_files.read(path, len(content) + 1) == content:
            return
    write_atomic(path, content, mode=mode)


def load_or_make(kind: str, mark: str, make: Callable[[], bytes], read: Callable[[bytes], T]) -> T:
    """Return what `read` makes of the content from `make`, out of the cache folder if it was made for an equal mark.

    Cached content on which `read` raises an error is damaged, and is made again.
    """
    try:
        folder = cache_folder() / "remembered" / kind
        name = digest(mark)
        with suppress(Unreadable), raise_unreadable():
            content = guarded_files.read(folder / name, MOST_RECORD)
            return read(content)
        content = make()
        for old in sorted(folder.glob("*"), key=lambda file: file.stat().st_mtime)[: -REMEMBERED + 1]:
            old.unlink(missing_ok=True)
        write_atomic(folder / name, content)
    except (OSError, BadInput):  # a cache that cannot be used costs only time
        return read(make())
    return read(content)


def digest(*parts: Any) -> str:
    """Return a content key: 32 hexadecimal digits of the SHA-256 of the parts as canonical JSON."""
    return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()[:32]


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def question_key(question: Question, interpreter: Interpreter) -> str:
    """Return a key that is equal for two cells exactly when one resolution serves both."""
    return digest("lock", question, interpreter.implementation, interpreter.version, os.uname().machine)


class InstallResult(Struct, frozen=True, kw_only=True):
    """The result of an install: the environment's key and what was found inside, or the step that failed.

    `modules` are the top-level modules of each package, `speaking` the packages that require an API, by API. `unheld`
    are requirements whose package is missing: the package that asks, and the requirement.
    """

    key: str | None = None
    versions: Mapping[str, str] = {}
    modules: Mapping[str, tuple[str, ...]] = {}
    speaking: Mapping[str, tuple[str, ...]] = {}
    unheld: tuple[tuple[str, str], ...] = ()
    seconds: float = 0.0
    findings: tuple[Finding, ...] = ()
    failed: Step | None = None


class _SummaryOfPhase(msgspec.Struct, frozen=True):
    outcome: Outcome
    peak_mb: int | None = None


class _SummaryOfCase(msgspec.Struct, frozen=True):
    case: str
    phases: tuple[_SummaryOfPhase, ...]


class StoredSummary(msgspec.Struct, frozen=True):
    """The part of a cell's record that is needed to schedule it."""

    seconds: float = 0.0
    cases: tuple[_SummaryOfCase, ...] = ()

    @property
    def phases(self) -> list[_SummaryOfPhase]:
        """Return the phases of all cases."""
        return [phase for case in self.cases for phase in case.phases]

    @property
    def peaks(self) -> dict[str, int]:
        """Return the most memory (MB) that each case held, where that was measured."""
        most = {case.case: max((phase.peak_mb or 0 for phase in case.phases), default=0) for case in self.cases}
        return {case: peak for case, peak in most.items() if peak}


class Store(Struct, frozen=True):
    """All that was measured, below one folder."""

    folder: Path

    def load_lock(self, key: str) -> Lock | Step | None:
        """Return the answer to a question: its lock, or the step that says why there is none; None if unanswered."""
        return self._load("locks", key, Lock) or self._load("steps", key, Step)

    def save_lock(self, key: str, answer: Lock | Step) -> None:
        """Keep a lock or a failed resolution; its pinned form lies beside it for people."""
        if isinstance(answer, Step):
            self._save("steps", key, answer)
            return
        self._save("locks", key, answer)
        write_atomic(self.lock_file(answer), answer.requirements.encode())

    def locked_at(self, key: str) -> int:
        """Return the time at which the lock of a question was made, in nanoseconds since the epoch."""
        return Path(self._path("locks", key)).stat().st_mtime_ns

    def lock_file(self, lock: Lock) -> Path:
        """Return the path of a lock's hash-pinned requirements; identical resolutions are one file."""
        return self.folder / "locks" / f"{lock.sha256[:16]}.txt"

    def load_installed(self, key: str) -> InstallResult | None:
        """Return the result of a lock's install, or None if there is none."""
        return self._load("installed", key, InstallResult)

    def save_installed(self, key: str, installed: InstallResult) -> None:
        """Keep the result of an install, good or bad."""
        self._save("installed", key, installed)

    def claim_file(self, key: str) -> Path:
        """Return the path of the lock file that marks a key as being worked on."""
        return self.folder / "claims" / f"{key}.lock"

    def instant(self, name: str, *, renew: bool = False, hours: float = float("inf")) -> str:
        """Return the cutoff of a matrix without a snapshot.

        It is the instant of the matrix's first lock, kept for `hours` or until renewed.
        """
        path = self.folder / "instants" / name
        with exclusive(path.with_name(f"{name}.lock")):  # of several first runs, one says it
            cutoff = _instant(path)
            if renew or cutoff is None or time() - path.stat().st_mtime > hours * 3600:
                cutoff = now()
                write_atomic(path, cutoff.encode())
            return cutoff

    def cell_file(self, machine: str, cell_id: str) -> Path:
        """Return the path of the last record of a cell on a machine."""
        return self.folder / "cells" / machine / f"{cell_id}.json"

    def save_cell(self, record: CellRecord) -> None:
        """Keep the record of a cell; one machine never overwrites another's."""
        write_changed(self.cell_file(record.machine, record.cell.id), _encode(record))

    def load_cell(self, machine: str, cell: Cell) -> CellRecord | None:
        """Return the last record of a cell on a machine, also where an earlier version kept it by its older id."""
        record = guarded_files.load(self.cell_file(machine, cell.id), CellRecord)
        if record is None and (
            before := guarded_files.load(self.cell_file(machine, cellid.to_old_form(cell)), CellRecord)
        ):
            record = replace(before, cell=_renamed(before.cell))
        return record if record and record.cell.id == cell.id else None

    def load_current(self, machine: str, cell: Cell) -> CellRecord | None:
        """Return the earlier record of a cell if it is still the same cell.

        Its expectation, and why it is tried, may have changed.
        """
        record = self.load_cell(machine, cell)
        if record and replace(record.cell, expect=cell.expect, tried=cell.tried) == cell:
            return replace(record, cell=cell, reused=True)
        return None

    def read_summary(self, machine: str, cell: Cell) -> StoredSummary | None:
        """Return the part of a cell's last record that shows its cost; None if there is no record."""
        files = (self.cell_file(machine, name) for name in (cell.id, cellid.to_old_form(cell)))
        return next((summary for file in files if (summary := guarded_files.load(file, StoredSummary))), None)

    def save_machine(self, name: str, facts: Mapping[str, Any]) -> None:
        """Keep the facts of a machine that cells are measured on."""
        write_changed(self.folder / "cells" / name / "machine.json", _encode(facts))

    def load_machine(self, name: str) -> dict[str, Any]:
        """Return the facts of a machine that cells were measured on."""
        return guarded_files.load(self.folder / "cells" / name / "machine.json", dict[str, Any]) or {}

    def has_cells(self) -> bool:
        """Return whether the record of any cell may be here."""
        return any((self.folder / "cells").glob("*/*/"))

    def cells(self) -> Iterator[CellRecord]:
        """Yield every cell record of every machine."""
        for path in sorted((self.folder / "cells").glob("*/*/*.json")):
            record = guarded_files.load(path, CellRecord)
            if record is None:
                continue
            cell = _renamed(record.cell)
            if cell is record.cell:
                yield record
            # A record under an older id gives way to one under today's id.
            elif not self.cell_file(record.machine, cell.id).exists():
                yield replace(record, cell=cell)

    def evidence(self, name: str) -> Path:
        """Return a folder for the logs, stacks and frames of a probe run; make it if need be."""
        folder = self.folder / "evidence" / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def relative(self, path: Path) -> str:
        """Return a path as records name it: below the state folder, never a machine's own."""
        return path.relative_to(self.folder).as_posix()

    def _path(self, kind: str, key: str) -> str:
        return f"{self.folder}/{kind}/{key[:2]}/{key[2:]}.json"

    def _load(self, kind: str, key: str, record_type: type[T]) -> T | None:
        return guarded_files.load(self._path(kind, key), record_type)

    def _save(self, kind: str, key: str, value: Any) -> None:
        write_atomic(Path(self._path(kind, key)), _encode(value))


def _instant(path: Path) -> str | None:
    """Return the instant that a file holds; None where there is none, or it is damaged."""
    try:
        text = guarded_files.text(path, MOST_INSTANT)
        with raise_unreadable():
            datetime.fromisoformat(text)
    except Absent:
        return None
    except Unreadable as error:
        logging.getLogger("harness").warning("%s: %s; the cutoff of this matrix is now", path, error)
        return None
    return text


def _renamed(cell: Cell) -> Cell:
    """Return the cell of a record, by its id of today; one of `try` keeps the id that it was measured by."""
    name = cellid.to_current_form(cell.id, cell.axes, cell.python if cell.base else None)
    base = cell.base and cellid.to_current_form(cell.base, cell.axes)
    return cell if name == cell.id else replace(cell, id=name, base=base)


def open_store() -> Store:
    """Return the store of the working folder."""
    return Store(state_folder())


def _encode(value: Any) -> bytes:
    return msgspec.json.encode(value, order="deterministic")

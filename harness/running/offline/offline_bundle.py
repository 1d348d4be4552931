"""Read the folder that `simmatrix fetch` filled, on a machine without network: matrices, locks, wheels, Pythons.

The folder is only read, so that many machines can share it. `manifest.json` is written last and names every file with
its hash; a file is compared with its hash before it is used.
"""

from __future__ import annotations

import os
import shutil
import tarfile
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import Literal

import msgspec

from harness.machine import interpreters
from harness.machine.files import given_files
from harness.machine.files.file_locks import exclusive
from harness.machine.store import digest, open_store, sha256_of, write_atomic
from harness.model import (
    Cell,
    IndexSettings,
    Interpreter,
    Lock,
    Outcome,
    Phase,
    Pin,
    Step,
    cellid,
    decoding,
    replace,
    schema,
)
from harness.model.errors import BadInput
from harness.packages import locks
from harness.packages.sources import builds
from harness.packages.step_failed import install_failed
from harness.running import controls

MANIFEST = "manifest.json"


class FetchedFile(msgspec.Struct, frozen=True, kw_only=True):
    """One file of the folder; `size` in bytes."""

    sha256: str
    size: int


class FetchedMatrix(msgspec.Struct, frozen=True, kw_only=True):
    """One matrix: its file, the others that it needs, the instant of its locks where it names none itself.

    `seconds` are those of cells in the report that is committed for it, by which its shards are balanced.
    """

    name: str
    file: str
    beside: tuple[str, ...] = ()
    instant: str | None = None
    seconds: dict[str, float] = {}


class FetchedCell(msgspec.Struct, frozen=True, kw_only=True):
    """One cell: the Python that its lock is for, the lock, its wheels; `decisive` is why it has no lock.

    `question` marks what was resolved; `complete` is false where the network or this machine got in the way.
    """

    id: str
    matrix: str
    question: str
    python: str | None = None
    implementation: str | None = None
    answer: str | None = None
    lock: str | None = None
    wheels: tuple[str, ...] = ()
    decisive: str | None = None
    complete: bool = True


class FetchedPython(msgspec.Struct, frozen=True, kw_only=True):
    """A Python that the cells need: its archive, or why it has to be there already."""

    implementation: str
    version: str
    file: str | None = None
    note: str | None = None


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The document `manifest.json` of `fetch`: paths are relative to its folder."""

    schema: Literal[1] = 1
    made: str
    harness: str
    architecture: str
    matrices: tuple[FetchedMatrix, ...] = ()
    cells: tuple[FetchedCell, ...] = ()
    pythons: tuple[FetchedPython, ...] = ()
    files: dict[str, FetchedFile] = {}


@dataclass(frozen=True, kw_only=True, slots=True)
class BuiltWheel:
    """A wheel that was built before: the key of its build, its file below the folder."""

    key: str
    file: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """The answer to a question: a lock whose wheels lie below the folder, or the step that failed."""

    lock: Lock | None = None
    step: Step | None = None
    built: Mapping[str, BuiltWheel] = field(default_factory=dict)


class Changed(Exception):
    """A file is gone or is not the one that was fetched."""


def read(folder: Path) -> Manifest:
    """Return the manifest of a folder. Raises BadInput if there is none: the fetch did not come to its end."""
    path = folder / MANIFEST
    try:
        content = given_files.read_content(path)
    except BadInput as error:
        message = f"{error}; `simmatrix fetch MATRIX --to {folder}` writes it, and continues where it stopped"
        raise BadInput(message) from None
    try:
        return schema.load_json(content, Manifest, str(path))
    except BadInput as error:
        message = f"{error}; remove the file and fetch again: complete files next to it are kept"
        raise BadInput(message) from None


def open_folder(folder: Path) -> Fetched:
    """Return the folder to run from. Raises BadInput if it is incomplete or for another kind of machine."""
    manifest = read(folder)
    here = os.uname().machine
    if manifest.architecture != here:
        message = (
            f"{folder}: was fetched for {manifest.architecture}, and this machine is {here}; fetch on such a machine"
        )
        raise BadInput(message)
    return Fetched(folder=folder.absolute(), manifest=manifest)


def question_mark(cell: Cell) -> str:
    """Return a mark of a cell's question, without the places of packages: these differ between machines."""
    return digest("question", replace(cell.question, index=IndexSettings()))


def request_for(implementation: str, version: str) -> str:
    """Return the request for exactly this Python."""
    name, _, build = implementation.partition("+")
    return ("" if name == "cpython" else name) + version + "t" * (build == "freethreaded")


@dataclass(frozen=True, kw_only=True)
class Fetched:
    """A folder that was fetched, as the source of everything that a run needs."""

    folder: Path
    manifest: Manifest
    _sound: set[str] = field(default_factory=set)
    _guard: threading.Lock = field(default_factory=threading.Lock)

    def matrix(self, name: str) -> tuple[FetchedMatrix, Path]:
        """Return the fetched matrix of a name, or of a file that has to be the same. Raises BadInput."""
        given = Path(name)
        stem = given.stem if given.suffix == ".toml" else name
        by_name = {one.name: one for one in self.manifest.matrices}
        if stem not in by_name:
            message = f"{name}: was not fetched into {self.folder}{schema.suggestion(stem, by_name)}"
            raise BadInput(message)
        entry = by_name[stem]
        try:
            # The files beside the matrix are compared here as well: planning reads them by path and knows no hashes.
            path, *_ = [self.sound(file) for file in (entry.file, *entry.beside)]
        except Changed as error:
            raise BadInput(str(error)) from None
        if given.suffix == ".toml" and (not given.is_file() or given.read_bytes() != path.read_bytes()):
            message = f"{name}: is not the matrix that was fetched; fetch it again, or run `{stem}`, as it was fetched"
            raise BadInput(message)
        return entry, path

    def instant(self, matrix: str) -> str | None:
        """Return the instant that a matrix was locked as of."""
        return next((one.instant for one in self.manifest.matrices if one.name == matrix), None)

    def seconds(self) -> dict[str, float]:
        """Return the recorded seconds of cells, by their ids."""
        return {cell: seconds for one in self.manifest.matrices for cell, seconds in one.seconds.items()}

    def interpreter(self, cell: Cell) -> Interpreter | str:
        """Return the very Python that a cell was locked for, or why the cell cannot be run."""
        entry = self._entry(cell)
        if entry is None:
            matrix = "MATRIX" if cell.matrix == controls.MATRIX else cell.matrix
            return f"was not fetched; `simmatrix fetch {matrix} --to {self.folder.name}` brings it"
        if entry.question != question_mark(cell):
            return "was fetched by another version of simmatrix; fetch it again"
        if entry.python is None or entry.implementation is None:
            return f"could not be fetched: {entry.decisive}"
        candidate = interpreters.obtain(cell.python, offline=True)
        wanted = (entry.implementation, entry.python)
        if candidate is not None and (candidate.implementation, candidate.version) == wanted:
            return candidate
        exact = self._exact(*wanted)
        if isinstance(exact, Interpreter):
            return exact
        there = f"there is {candidate.version}" if candidate else "it is not on this machine"
        return f"its lock is for {entry.implementation} {entry.python}, and {there}{exact}"

    def answer(self, cell: Cell) -> tuple[Lock | None, Step]:
        """Return the lock of a cell, its wheels named by their paths here, and how it came; or the step that failed.

        The lock's requirements are written beside the results. The answer itself is not kept, since it holds for this
        folder only.
        """
        entry = self._entry(cell)
        if entry is None or entry.answer is None:
            reason = f"was not fetched: {entry.decisive if entry else 'it is new'}; fetch it again"
            return None, Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=reason)
        try:
            stored = self._answer(entry.answer)
        except Changed as error:
            return None, Step(phase=Phase.RESOLVE, outcome=Outcome.INFRA, decisive=str(error))
        if stored.lock is None:
            assert stored.step
            return None, replace(stored.step, reused=True)
        lock = replace(stored.lock, pins=tuple(map(self._here, stored.lock.pins)))
        file = open_store().lock_file(lock)
        if not file.exists():
            write_atomic(file, lock.requirements.encode())
        return lock, Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED, reused=True)

    def supply(self, cell: Cell, lock: Lock, interpreter: Interpreter) -> None:
        """Compare the wheels of a cell with their hashes and hand over built wheels. Raises StepFailed."""
        try:
            entry = self._entry(cell)
            built = self._answer(entry.answer or "" if entry else "").built
            for pin in lock.pins:
                if pin.name in built:
                    wheel = self.sound(built[pin.name].file)
                    builds.adopt(pin, interpreter, cell.question, built[pin.name].key, wheel)
                else:
                    wheel = self.sound(Path(pin.artifact.source).relative_to(self.folder).as_posix())
                # `open_folder` compares the architecture only; whether the C library is new enough shows in the tags.
                if locks.rank(wheel.name, interpreter)[0] == locks.UNRANKED:
                    message = (
                        f"{wheel.name} does not fit this machine (its C library is older?); fetch on such a machine"
                    )
                    raise Changed(message)
        except Changed as error:
            raise install_failed(Outcome.INFRA, str(error)) from None

    def sound(self, name: str) -> Path:
        """Return the path of a file that is as it was fetched; each process hashes it once. Raises Changed."""
        path, wanted = self.folder / name, self.manifest.files.get(name)
        with self._guard:
            if name not in self._sound:
                if wanted is None or not path.is_file():
                    message = f"{path}: is not there; fetch it again"
                    raise Changed(message)
                if path.stat().st_size != wanted.size or sha256_of(path) != wanted.sha256:
                    message = f"{name}: is not the file that was fetched, its SHA-256 is another; fetch it again"
                    raise Changed(message)
                self._sound.add(name)
        return path

    @cached_property
    def _cells(self) -> dict[str, FetchedCell]:
        return {one.id: one for one in self.manifest.cells}

    def _entry(self, cell: Cell) -> FetchedCell | None:
        """Return the fetched entry of a cell, by its id of today or by that of earlier versions."""
        return self._cells.get(cell.id) or self._cells.get(cellid.to_old_form(cell))

    def _answer(self, name: str) -> Answer:
        return decoding.decoder(Answer).decode(self.sound(name).read_bytes())

    def _here(self, pin: Pin) -> Pin:
        """Return a pin with the path of its wheel; an sdist's pin stays, its built wheel is handed over instead."""
        if not pin.artifact.is_wheel:
            return pin
        return replace(pin, artifact=replace(pin.artifact, source=str(self.folder / pin.artifact.source)))

    def _exact(self, implementation: str, version: str) -> Interpreter | str:
        """Return this Python, from this machine or unpacked from the folder; else what to do about it."""
        request = request_for(implementation, version)
        interpreter = interpreters.obtain(request, offline=True)
        if interpreter is not None:
            return interpreter
        entry = {(one.implementation, one.version): one for one in self.manifest.pythons}.get((implementation, version))
        if entry is None or entry.file is None:
            return f"; install {version} here, or fetch on a machine with the Python that is here"
        try:
            interpreter = unpack(self.sound(entry.file), request)
        except Changed as error:
            return f"; {error}"
        return interpreter or f"; {entry.file} does not start on this machine"


def unpack(archive: Path, request: str) -> Interpreter | None:
    """Put a packed Python among those that the harness looks after, and return it; None if it does not start."""
    folder = interpreters.managed_folder() / archive.name.removesuffix(".tar")
    with exclusive(folder.with_name(f"{folder.name}.lock")):
        if not folder.exists():
            making = Path(mkdtemp(dir=folder.parent, prefix=".making-"))
            try:
                # The filter refuses members that lie outside: a bundle may be somebody else's (docs/threat-model.md).
                with tarfile.open(archive) as tar:
                    tar.extractall(making, filter="data")
                (making / folder.name).rename(folder)
            finally:
                shutil.rmtree(making)
    interpreters.look_again()
    return interpreters.obtain(request, offline=True)

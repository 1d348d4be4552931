"""Collect in a folder the locks, wheels, builds and Pythons of cells; `offline_bundle` reads it without network.

A file comes into place whole or not at all and is never changed, the manifest is written last: a fetch that was
killed goes on where it was, and what an earlier one brought stays valid.
"""

from __future__ import annotations

import tarfile
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread

import msgspec

from harness.machine import interpreters
from harness.machine.store import Store, digest, question_key, sha256_of, write_atomic
from harness.model import Artifact, CellRecord, IndexSettings, Lock, Outcome, Pin, Step, replace
from harness.model.errors import CouldNotTell
from harness.model.report_types import format_count
from harness.packages import download_notice, index
from harness.packages.environments import environments
from harness.packages.sources import overlays
from harness.packages.step_failed import StepFailed
from harness.running import controls
from harness.running.offline import offline_bundle
from harness.running.offline.offline_bundle import (
    Answer,
    BuiltWheel,
    FetchedCell,
    FetchedFile,
    FetchedMatrix,
    FetchedPython,
    Manifest,
)

AT_ONCE = 4
"""Downloads side by side; more help no one when the wheels are large."""

TOLD_SECONDS = 15.0
"""How long a large download goes on without a word."""

_BUILT = "build:"

NOT_RELOCATABLE = "was built or installed on the machine that fetched, and runs at its own path only"


def load_intact(folder: Path) -> Manifest | None:
    """Return the manifest of an earlier fetch, without the parts that changed since; None if there is none.

    Files that are no longer as they were fetched are removed.
    """
    # Left by a fetch that was killed. No other one runs now: `commands/fetch.py` holds the lock of the folder.
    for leftover in folder.glob("wheels/*/tmp*"):
        leftover.unlink()
    if not (folder / offline_bundle.MANIFEST).exists():
        return None
    old = offline_bundle.read(folder)
    sound = {name for name, file in old.files.items() if _is_sound(folder / name, file)}
    for name in old.files.keys() - sound:
        (folder / name).unlink(missing_ok=True)
    matrices = tuple(one for one in old.matrices if {one.file, *one.beside} <= sound)
    names = {one.name for one in matrices} | {controls.MATRIX}
    cells = tuple(one for one in old.cells if one.matrix in names and _files(one) <= sound)
    pythons = tuple(one for one in old.pythons if one.file is None or one.file in sound)
    manifest = msgspec.structs.replace(old, matrices=matrices, cells=cells, pythons=pythons)
    if manifest != old:
        write(folder, manifest)
    return manifest


def write(folder: Path, manifest: Manifest) -> None:
    """Write the manifest; files that none of its parts names are left out of its list."""
    named = {name for one in manifest.matrices for name in (one.file, *one.beside)}
    named |= {name for cell in manifest.cells for name in _files(cell)}
    named |= {one.file for one in manifest.pythons if one.file}
    files = {
        name: manifest.files.get(name)
        or FetchedFile(sha256=sha256_of(folder / name), size=(folder / name).stat().st_size)
        for name in sorted(named)
    }
    document = msgspec.structs.replace(manifest, files=files)
    write_atomic(folder / offline_bundle.MANIFEST, msgspec.json.format(msgspec.json.encode(document), indent=1) + b"\n")


@dataclass(frozen=True, kw_only=True, slots=True)
class _Resolved:
    """A cell on its way: its entry, and the lock with its files' addresses; without a lock the entry is complete."""

    record: CellRecord
    entry: FetchedCell
    lock: Lock | None = None
    built: Mapping[str, BuiltWheel] = field(default_factory=dict)


@dataclass
class Collector:
    """One fetch into a folder. `say` tells the user what is going on."""

    folder: Path
    store: Store
    say: Callable[[str], None]
    brought: int = 0
    """Bytes that were not in the folder before."""

    def cells(self, records: Sequence[CellRecord]) -> tuple[FetchedCell, ...]:
        """Bring the locks and wheels of cells that were resolved; a cell that has none keeps the reason."""
        resolved = [self._resolved(record) for record in records]
        wanted = {
            pin.artifact.sha256: (pin.artifact, one.record.cell.question.index)
            for one in resolved
            for pin in (one.lock.pins if one.lock else ())
            if pin.artifact.is_wheel
        }
        failures = self._download(list(wanted.values()))
        return tuple(self._cell(one, failures) for one in resolved)

    def files(self, matrix: str, files: Mapping[str, Path], instant: str | None) -> FetchedMatrix:
        """Bring the files of a matrix, the matrix itself first."""
        names = {name: f"matrices/{matrix}/{name}" for name in files}
        for name, path in files.items():
            write_atomic(self.folder / names[name], path.read_bytes())
        first, *beside = names.values()
        return FetchedMatrix(name=matrix, file=first, beside=tuple(beside), instant=instant)

    def pythons(self, cells: Iterable[FetchedCell]) -> tuple[FetchedPython, ...]:
        """Bring the Pythons that run wherever they are put; say of the others that they have to be there."""
        wanted = {(one.implementation, one.python) for one in cells if one.implementation and one.python}
        return tuple(self._python(implementation, version) for implementation, version in sorted(wanted))

    def _resolved(self, record: CellRecord) -> _Resolved:
        """Build a cell's sdists and return the cell with its lock, or with the reason why it has none."""
        cell, interpreter = record.cell, interpreters.obtain(record.cell.python)
        entry = FetchedCell(id=cell.id, matrix=cell.matrix, question=offline_bundle.question_mark(cell))
        if record.unavailable or interpreter is None or record.resolve is None:
            reason = record.unavailable or interpreters.hint(cell.python)
            return _Resolved(record=record, entry=msgspec.structs.replace(entry, decisive=reason, complete=False))
        entry = msgspec.structs.replace(entry, python=interpreter.version, implementation=interpreter.implementation)
        lock = self.store.load_lock(question_key(cell.question, interpreter))
        if record.lock is None or not isinstance(lock, Lock):
            # Its metadata may be what a build makes, and so an install fails while it is resolved.
            return _Resolved(record=record, entry=self._failed(entry, record.install or record.resolve))
        try:
            lock = overlays.provide_wheels(lock, cell.question)
            if not all(pin.artifact.is_wheel for pin in lock.pins):
                self.say(f"{cell.id}: building what has no wheel")
            wheels = environments.wheels_of(lock, interpreter, cell.question)
        except StepFailed as failed:
            return _Resolved(record=record, entry=self._failed(entry, failed.step))
        built = {one.name: self._built(one) for one in wheels if one.mark.startswith(_BUILT)}
        return _Resolved(record=record, entry=entry, lock=lock, built=built)

    def _built(self, wheel: environments.Wheel) -> BuiltWheel:
        key = wheel.mark.removeprefix(_BUILT)
        name = f"builds/{key}/{wheel.artifact.filename}"
        if not (self.folder / name).exists():
            content = Path(wheel.artifact.source).read_bytes()
            write_atomic(self.folder / name, content)
            self.brought += len(content)
        return BuiltWheel(key=key, file=name)

    def _cell(self, resolution: _Resolved, failures: Mapping[str, str]) -> FetchedCell:
        entry = resolution.entry
        if resolution.lock is None:
            return entry
        wheels = [pin.artifact for pin in resolution.lock.pins if pin.artifact.is_wheel]
        lost = [failures[wheel.sha256] for wheel in wheels if wheel.sha256 in failures]
        if lost:
            return msgspec.structs.replace(entry, decisive=lost[0], complete=False)
        lock_file = f"locks/{resolution.lock.sha256[:16]}.txt"
        write_atomic(self.folder / lock_file, resolution.lock.requirements.encode())
        portable = replace(resolution.lock, pins=tuple(map(_portable, resolution.lock.pins)))
        files = (*map(_place, wheels), *(built.file for built in resolution.built.values()))
        answer = self._write(entry, Answer(lock=portable, built=resolution.built))
        return msgspec.structs.replace(entry, answer=answer, lock=lock_file, wheels=tuple(sorted(files)))

    def _failed(self, entry: FetchedCell, step: Step) -> FetchedCell:
        """Return the entry of a cell without a lock.

        A fault of the packages is kept as an answer. Another day's trouble is none: the entry is then incomplete.
        """
        if step.outcome not in {Outcome.FAILED, Outcome.UNAVAILABLE}:
            return msgspec.structs.replace(entry, decisive=step.decisive, complete=False)
        # The log and the conditions of this machine mean nothing on another one.
        answer = self._write(entry, Answer(step=replace(step, log=None, conditions=None, reused=False)))
        return msgspec.structs.replace(entry, decisive=step.decisive, answer=answer)

    def _write(self, entry: FetchedCell, answer: Answer) -> str:
        """Put an answer into a file named by its content, so that none is ever changed."""
        content = msgspec.json.encode(answer, order="deterministic")
        name = f"answers/{digest('answer', entry.question, content.decode())}.json"
        write_atomic(self.folder / name, content)
        return name

    def _download(self, wanted: Sequence[tuple[Artifact, IndexSettings]]) -> dict[str, str]:
        """Bring files that are not there; return why not, by the hash of each that could not be had."""
        missing = [(artifact, settings) for artifact, settings in wanted if not self._has(artifact)]
        download_notice.announce([artifact for artifact, _ in missing], frozenset())
        todo: SimpleQueue[tuple[Artifact, IndexSettings]] = SimpleQueue()
        done: SimpleQueue[tuple[Artifact, str | None]] = SimpleQueue()
        for download in sorted(missing, key=lambda pair: -(pair[0].size or 0)):
            todo.put(download)
        for _ in range(min(AT_ONCE, len(missing))):
            # daemons: an interrupt does not wait for the end of a download of gigabytes
            Thread(target=_fetch_all, args=(self.folder / "wheels", todo, done), daemon=True).start()
        failures = {}
        for count in range(1, len(missing) + 1):
            artifact, trouble = self._next(done)
            if trouble is None:
                size = (self.folder / _place(artifact)).stat().st_size
                self.brought += size
                self.say(f"[{count}/{len(missing)}] {artifact.filename} ({size / 1e6:.1f} MB)")
            else:
                failures[artifact.sha256] = trouble
                self.say(f"[{count}/{len(missing)}] {trouble}")
        return failures

    def _next(self, done: SimpleQueue[tuple[Artifact, str | None]]) -> tuple[Artifact, str | None]:
        """Wait for the next download to end, telling now and then how much of those under way has come."""
        while True:
            try:
                return done.get(timeout=TOLD_SECONDS)
            except Empty:
                sizes = []
                for path in self.folder.glob("wheels/*/tmp*"):
                    with suppress(FileNotFoundError):  # it came to its end
                        sizes.append(path.stat().st_size)
                self.say(f"{format_count(len(sizes), 'file')} under way, {sum(sizes) / 1e6:.0f} MB of them here")

    def _has(self, artifact: Artifact) -> bool:
        """Return whether the file is there; remove a file with another hash.

        A file that no manifest names was never compared before.
        """
        path = self.folder / _place(artifact)
        if path.exists() and sha256_of(path) != artifact.sha256:
            path.unlink()
        return path.exists()

    def _python(self, implementation: str, version: str) -> FetchedPython:
        entry = FetchedPython(implementation=implementation, version=version)
        interpreter = interpreters.obtain(offline_bundle.request_for(implementation, version))
        folder = interpreters.relocatable(interpreter) if interpreter else None
        if folder is None:
            return msgspec.structs.replace(entry, note=NOT_RELOCATABLE)
        name = f"pythons/{folder.name}.tar"
        if not (self.folder / name).exists():
            self.say(f"packing Python {version}")
            self.brought += pack(folder, self.folder / name)
        return msgspec.structs.replace(entry, file=name)


def pack(folder: Path, target: Path) -> int:
    """Write a folder as a tar file, whole or not at all; return its size in bytes."""
    target.parent.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".making-") as making:
        path = Path(making) / target.name
        with tarfile.open(path, "w") as tar:
            tar.add(folder, folder.name, filter=lambda member: None if "__pycache__" in member.name else member)
        path.chmod(0o644)
        path.replace(target)
    return target.stat().st_size


def _fetch_all(
    folder: Path,
    todo: SimpleQueue[tuple[Artifact, IndexSettings]],
    done: SimpleQueue[tuple[Artifact, str | None]],
) -> None:
    while True:
        try:
            artifact, settings = todo.get_nowait()
        except Empty:
            return
        try:
            index.fetch(artifact, folder, settings)
            done.put((artifact, None))
        except (CouldNotTell, OSError) as error:
            done.put((artifact, str(error)))


def _portable(pin: Pin) -> Pin:
    """Return a pin that names its wheel by its place in the folder, and of an sdist nothing but its name."""
    source = _place(pin.artifact) if pin.artifact.is_wheel else pin.artifact.filename
    return replace(pin, artifact=replace(pin.artifact, source=source))


def _place(wheel: Artifact) -> str:
    """Return the place of a wheel below the folder, as `index.fetch` names it."""
    return f"wheels/{wheel.sha256[:16]}/{wheel.filename}"


def _files(cell: FetchedCell) -> set[str]:
    return {name for name in (cell.answer, cell.lock, *cell.wheels) if name}


def _is_sound(path: Path, file: FetchedFile) -> bool:
    return path.is_file() and path.stat().st_size == file.size and sha256_of(path) == file.sha256

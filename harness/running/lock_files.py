"""Write locks for users: a header that says what they are, and beside them the patched wheels that no index has."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.machine import store
from harness.machine.files import given_files
from harness.matrix import overlay_recipes
from harness.model import Repair
from harness.model.errors import CouldNotTell
from harness.packages import locks
from harness.packages.index_settings import NOTHING
from harness.packages.sources import overlays
from harness.packages.step_failed import StepFailed
from harness.running import open_matrix

WHEELS = "-wheels"


@dataclass(frozen=True, kw_only=True, slots=True)
class MeasuredLock:
    """A lock to be written: its text, and the cell that it was measured in."""

    lock: str
    cell: str
    python: str
    machine: str
    measured: str
    settings: Mapping[str, str]


def write(path: Path, handed: MeasuredLock, *, offline: bool = False) -> str:
    """Write a lock with its header, and its patched wheels into a folder beside it; return the command that installs.

    Raises CouldNotTell where a patched wheel cannot be made here.
    """
    folder = path.with_name(path.stem + WHEELS)
    patched = _patched(handed.lock)
    # Wheels before the lock: where one cannot be made, no lock is written that needs it.
    for repair in patched:
        try:
            wheel = overlays.wheel(repair, NOTHING, offline=offline)
        except StepFailed as failed:
            message = f"{path} was not written: {failed.step.decisive}"
            raise CouldNotTell(message) from None
        store.write_atomic(store.writable(folder) / wheel.name, wheel.read_bytes())
    command = install(path, handed.python, folder if patched else None)
    given_files.write_text(path, header(handed, command) + handed.lock)
    return command


def header(handed: MeasuredLock, command: str = "") -> str:
    """Return comment lines that say which cell a lock was measured in, and how it is installed, if a command does."""
    settings = " ".join(f"{name}={value}" for name, value in handed.settings.items())
    lines = [
        f"simmatrix: {handed.cell}",
        f"Python {handed.python}, measured {handed.measured[:10]} on {handed.machine}",
        *([f"set: {settings}"] if settings else []),
        *([f"install: {command}"] if command else []),
    ]
    return "".join(f"# {line}\n" for line in lines)


def install(path: Path, python: str, wheels: Path | None = None) -> str:
    """Return the commands that install a lock into a new environment."""
    minor = ".".join(python.split(".")[:2])
    links = f" --find-links {shlex.quote(str(wheels))}" if wheels else ""
    return f"uv venv --python {minor} && uv pip sync --require-hashes{links} {shlex.quote(str(path))}"


def _patched(lock: str) -> tuple[Repair, ...]:
    """Return the recipes of the patched wheels that a lock holds."""
    hashes = [mark for _, marks in locks.read_pins(lock).values() for mark in marks]
    repairs = [repair for made in open_matrix.recipes(Path("matrices")).values() for repair in made]
    return overlay_recipes.select_by_hash(repairs, hashes)

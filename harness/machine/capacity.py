"""Measure the cores and the memory that this process may use: what the machine and its control group leave to it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from harness.machine import process

AUTO = 0
"""As many cells at a time as there are cores, and no more than the free memory has room for."""


def default_jobs() -> int:
    """Return the number of cores that this process may use: one cell is measured per core.

    SLURM_CPUS_PER_TASK is an upper bound: not every Slurm holds a task to the cores that it was given.
    """
    cores, given = len(os.sched_getaffinity(0)), os.environ.get("SLURM_CPUS_PER_TASK", "")
    return max(1, min(cores, int(given))) if given.isdigit() else cores


class Reading(Struct, frozen=True, kw_only=True):
    """MB that can be taken without swapping, None if unknown; and the MB that each running command holds already."""

    free_mb: int | None
    held_mb: tuple[int, ...]


def reading() -> Reading:
    """Return the memory of this moment."""
    return Reading(free_mb=free_mb(), held_mb=process.resident_mb())


def free_mb(root: Path = Path("/")) -> int | None:
    """Return the least MB that the machine and each control group above this process leave; None if unknown.

    `root` is the root of the file system.
    """
    free_bytes = [*_machine(root), *_groups(root)]
    return max(0, min(free_bytes)) >> 20 if free_bytes else None


def _machine(root: Path) -> Iterator[int]:
    for line in _lines(root / "proc/meminfo"):
        if line.startswith("MemAvailable:"):
            yield int(line.split()[1]) << 10


def _groups(root: Path) -> Iterator[int]:
    """Yield the bytes left under the limit of each control group, from our own up to the root, in cgroups v1 and v2."""
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            base, names = root / "sys/fs/cgroup", ("memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            base = root / "sys/fs/cgroup/memory"
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        else:
            continue
        # A container may see only the uppermost group, though the path is the machine's: an absent folder yields none.
        own = base / path.strip("/")
        for folder in (own, *own.parents):
            if not folder.is_relative_to(base):
                break
            yield from _left(folder, *names)


def _left(folder: Path, limit: str, usage: str, cached: str) -> Iterator[int]:
    """Yield the limit less the bytes in use; the file cache is not counted, since it goes first."""
    most, used = _number(folder / limit), _number(folder / usage)
    if most is not None and used is not None:
        stat = dict(line.split(" ", 1) for line in _lines(folder / "memory.stat"))
        yield most - used + int(stat.get(cached, 0))


def _number(path: Path) -> int | None:
    """Return the number in a file; None if there is none (`max`, no such file)."""
    text = "".join(_lines(path))
    return int(text) if text.isdigit() else None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []

"""Find the parts of cache and state that can be made again, choose by waste, age and size, and remove them.

Waste is what nothing will ever ask for: folders of processes that were killed, environments without a stamp, compiled
bytecode without its environment, logs that no record names. The rest goes by age or size. The record of a cell, the
logs and the lock that it names, and the interpreters are never touched; nor are probe runs, unless they are asked for
by name: those that no record of a cell leads to any more.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Set
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from stat import S_ISDIR
from time import time

from harness.machine.files import file_locks, guarded_files
from harness.machine.files.scratch_folders import remove_folder
from harness.machine.store import MOST_RECORD
from harness.model.hostile_data import Unreadable
from harness.packages import uv_command
from harness.probes.evidence import folder_of

DAY = 86400.0
"""Seconds before which nothing of the state, and no scratch folder, is taken for waste: it may be being written."""

BLOCK = 512
"""Bytes of a block as the system counts them."""

EVIDENCE = re.compile(rb"evidence/([A-Za-z0-9._~-]+)")
CONTENT = re.compile(rb"\b[0-9a-f]{32,64}\b")


class Kind(StrEnum):
    """The kinds of things that can be removed, as people read them."""

    ENVIRONMENT = "environments"
    WHEEL = "built wheels"
    METADATA = "metadata of sdists"
    REPOSITORY = "repositories"
    BROUGHT = "copies of what users brought"
    UV = "downloads (uv's cache)"
    COMPILED = "compiled bytecode"
    SCRATCH = "left behind by killed processes"
    EVIDENCE = "logs and frames"
    RECORD = "results that no cell has"
    RUN = "probe runs that no cell has"


@dataclass(frozen=True, kw_only=True, slots=True)
class Item:
    """A thing that is removed as a whole. `used` is when it was of use last (seconds since 1970).

    `size` is its share of the disk in bytes: of a file with several names, such as one that uv's cache and an
    environment share, each name has an equal part.
    """

    kind: Kind
    paths: tuple[Path, ...]
    used: float
    waste: bool
    size: float


def disk_usage(*folders: Path) -> int:
    """Return the bytes on disk of all in these folders, each file counted once."""
    sizes = {(status.st_dev, status.st_ino): status.st_blocks for path in folders for status in _within(path)}
    return sum(sizes.values()) * BLOCK


def _within(path: Path) -> Iterator[os.stat_result]:
    """Yield the status of a file, or of a folder and all in it; what is going just now is left out."""
    waiting = [path]
    while waiting:
        at = waiting.pop()
        with suppress(OSError):
            status = at.lstat()
            yield status
            if S_ISDIR(status.st_mode):
                waiting += at.iterdir()


# --- what there is ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, slots=True)
class Places:
    """The places to look at; `state` and `temporary` need not exist. With `evidence` probe runs are looked at, too."""

    cache: Path
    state: Path
    evidence: bool = False
    temporary: Path = field(default_factory=lambda: Path(tempfile.gettempdir()))


def find(places: Places, now: float | None = None) -> list[Item]:
    """Return everything that could go, the least recently used first."""
    instant = time() if now is None else now
    items = [*_environments(places.cache), *_cached(places.cache), *_scratch(places, instant)]
    if places.state.is_dir():
        # What is younger may be being written, or belong to a record that is still to come.
        items += (item for item in _state(places, instant) if instant - item.used > DAY)
    return sorted(items, key=lambda item: (item.used, item.paths))


def _item(kind: Kind, *paths: Path, used: float | None = None, waste: bool = False) -> Item:
    size, newest = 0.0, 0.0
    for status in (status for path in paths for status in _within(path)):
        folder = S_ISDIR(status.st_mode)
        size += status.st_blocks * BLOCK / (1 if folder else status.st_nlink)
        newest = max(newest, status.st_mtime) if folder or status.st_nlink == 1 else newest
    return Item(kind=kind, paths=paths, used=newest if used is None else used, waste=waste, size=size)


def _environments(cache: Path) -> Iterator[Item]:
    """Yield each environment with its compiled bytecode, and bytecode whose environment is gone."""
    for path, status in _folders(cache / "environments"):
        compiled = [place for place in [cache / "pycache" / path.name] if place.is_dir()]
        whole = (path / "stamp.json").is_file()
        # `file_locks.mark_used` sets the time of the folder at each use, so that it tells the last one.
        yield _item(Kind.ENVIRONMENT, path, *compiled, used=status.st_mtime, waste=not whole)
    for path, _ in _folders(cache / "pycache"):
        if not (cache / "environments" / path.name).is_dir():
            yield _item(Kind.COMPILED, path, waste=True)


def _cached(cache: Path) -> Iterator[Item]:
    kinds = {"wheels": Kind.WHEEL, "uv-builds": Kind.METADATA, "repositories": Kind.REPOSITORY, "brought": Kind.BROUGHT}
    for name, kind in kinds.items():
        for path, status in _folders(cache / name):
            # `wheels/requests` stays: it says which build a request led to, and tells `_state` which logs to keep.
            if path.name != "requests":
                yield _item(kind, path, used=status.st_mtime)
    if (cache / "uv").is_dir():
        yield _item(Kind.UV, cache / "uv", used=(cache / "uv").stat().st_mtime)


def _scratch(places: Places, now: float) -> Iterator[Item]:
    """Yield folders of this user that are a day old and that no living process mentions."""
    candidates = [*_folders(places.cache / "tmp"), *_folders(places.temporary, "simmatrix-*")]
    old = [path for path, status in candidates if now - status.st_mtime > DAY and status.st_uid == os.getuid()]
    process_texts = _read_process_texts() if old else b""
    for path in old:
        if os.fsencode(path.name) not in process_texts:
            yield _item(Kind.SCRATCH, path, waste=True)


def _read_process_texts() -> bytes:
    """Return the command lines, variables and working folders of all processes, as far as this user may read them."""
    texts = []
    for process in Path("/proc").glob("[0-9]*"):
        for name in ("cmdline", "environ"):
            with suppress(OSError):
                texts.append((process / name).read_bytes())
        with suppress(OSError):
            texts.append(os.fsencode((process / "cwd").readlink()))
    return b"\n".join(texts)


def _folders(parent: Path, pattern: str = "*") -> Iterator[tuple[Path, os.stat_result]]:
    for path in sorted(parent.glob(pattern) if parent.is_dir() else ()):
        with suppress(OSError):  # it may have gone just now
            status = path.lstat()
            if S_ISDIR(status.st_mode):
                yield path, status


# --- the state -------------------------------------------------------------------------------------------------


def _state(places: Places, now: float) -> Iterator[Item]:
    """Yield records that no cell's record leads to, and locks and logs that nothing names."""
    cells = set().union(*(_names(path) for path in (places.state / "cells").glob("**/*.json")))
    references = set(cells)
    for kind in ("steps", "locks", "installed"):
        for path in sorted((places.state / kind).glob("*/*.json")):
            # uv's output for a question is kept by the question's own key (`Runner.lock`).
            names = _names(path) | {f"lock-{path.parent.name}{path.stem}"[: len("lock-") + 16]}
            if not names & cells:
                yield _item(Kind.RECORD, path, used=path.stat().st_mtime)
            references |= names
    references |= {f"build-{path.stem}" for path in (places.cache / "wheels" / "requests").glob("*.txt")}
    # The files of locks and the folders of runs have only 16 digits of a name (`Store.lock_file`, `folder_of`).
    starts = {name[:16] for name in references}
    for path in sorted((places.state / "locks").glob("*.txt")):
        if path.stem not in starts:
            yield _item(Kind.RECORD, path, waste=True)
    for path, _ in _folders(places.state, "results"):  # of an earlier version, which no later one reads
        yield _item(Kind.RECORD, path, waste=True)
    for path, _ in _folders(places.state / "evidence"):
        if path.name not in references | starts:
            yield _item(Kind.EVIDENCE, path, waste=True)
    if places.evidence:
        yield from _runs(places.state / "vault", references, now)


def _runs(vault: Path, named: Set[str], now: float) -> Iterator[Item]:
    """Yield claims on runs none of which a record names, and contents to which no other claim leads."""
    needed: set[str] = set()
    for claim in sorted((vault / "ac").glob("*/*")):
        runs = {name.decode() for name in CONTENT.findall(_content(claim))}
        used = claim.stat().st_mtime
        if now - used > DAY and not any({run, folder_of(run).rpartition("/")[2]} & named for run in runs):
            yield _item(Kind.RUN, claim, used=used, waste=True)
            continue
        needed |= runs
        for run in runs:
            needed |= {name.decode() for name in CONTENT.findall(_content(vault / "cas" / run[:2] / run[2:]))}
    for path in sorted((vault / "cas").glob("*/*")):
        if path.parent.name + path.name not in needed:
            yield _item(Kind.RUN, path, used=path.stat().st_mtime, waste=True)


def _content(path: Path) -> bytes:
    try:
        return guarded_files.read(path, MOST_RECORD)
    except Unreadable:
        return b""


def _names(record: Path) -> set[str]:
    """Return the evidence that a record names, and the keys and hashes by which records refer to each other."""
    content = _content(record)  # a damaged one names nothing any more
    keys = {found.decode() for found in CONTENT.findall(content)}
    return {found.decode() for found in EVIDENCE.findall(content)} | keys | {f"install-{key}" for key in keys}


# --- choosing and removing -------------------------------------------------------------------------------------


def select_items(items: Iterable[Item], size: float, *, before: float | None, most: int | None) -> list[Item]:
    """Return the items to remove, by waste, age and size.

    These are waste, items that were not of use since `before`, then the least recently used until no more than `most`
    bytes are left. `size` is that of everything now, in bytes.
    """
    every = list(items)
    goes = [item for item in every if item.waste or (before is not None and item.used < before)]
    left = size - sum(item.size for item in goes)
    for item in every:
        if most is None or left <= most:
            break
        if item not in goes:
            left -= item.size
            goes.append(item)
    return goes


def remove(item: Item) -> bool:
    """Remove an item unless somebody uses it; return False if it was kept."""
    match item.kind:
        case Kind.ENVIRONMENT | Kind.WHEEL | Kind.METADATA | Kind.REPOSITORY | Kind.BROUGHT:
            return _removed_unused(item)
        case Kind.UV:
            with file_locks.hold_unused(item.paths[0]) as free:
                return _free(item, free) and uv_command.tidy("clean")
        case _:
            for path in item.paths:
                if path.is_dir() and not path.is_symlink():
                    remove_folder(path)
                else:
                    path.unlink(missing_ok=True)
            return True


def _removed_unused(item: Item) -> bool:
    """Move the item aside in one step, so that nobody finds half of it, then remove it; return False if it is used."""
    place = item.paths[0]
    # Whoever makes or withdraws it holds this lock (`environments.discard`, `checkouts.of_repository`).
    making = file_locks.claim([place.with_name(f"{place.name}.lock")], wait=False)
    if making is None:
        return False
    try:
        with file_locks.hold_unused(place) as free:
            if not _free(item, free):
                return False
            # This scratch folder lies on the disk of the cache: across disks a rename fails.
            with uv_command.scratch() as aside:
                for number, path in enumerate(item.paths):
                    with suppress(FileNotFoundError):
                        path.rename(aside / str(number))
        return True
    finally:
        making.release()


def _free(item: Item, free: bool | None) -> bool:
    """Return whether an item may go; if nobody can tell whether it is in use, only after a day."""
    return time() - item.used > DAY if free is None else free

"""Keep byte code as a folder of files; each has its size, time and hash in a table, so that no damaged one is used.

A folder is never changed, since runs may have a layer over it: more code makes a new one, with links to the files of
the old one, which goes a day later.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct

from harness.machine.files.guarded_files import read
from harness.machine.files.scratch_folders import remove_folder
from harness.machine.store import write_atomic
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable

TABLE, FOLDER = "code", "tree-"
"""The name of the table, and how the name of its folder begins."""

MOST_TABLE, MOST_FILE = 64 << 20, 256 << 20
DAY = 86_400.0
BOOT = Path("/proc/sys/kernel/random/boot_id")


class File(NamedTuple):
    """A file of byte code: where it is below its folder, its size, time of change and hash.

    `mark` is the time and size of its source, as Python writes them into byte code, in hexadecimal. An empty `path`
    means that the source cannot be compiled.
    """

    path: str
    size: int = 0
    time: int = 0
    digest: str = ""
    mark: str = ""


class Tree(Struct, frozen=True, kw_only=True):
    """Byte code by the names of its sources, and the folder of its files. `whole` is false where some was damaged."""

    folder: Path
    files: Mapping[str, File]
    whole: bool = True


class Linked(NamedTuple):
    """Byte code that is a file already."""

    place: str
    file: File

    @classmethod
    def to(cls, place: Path) -> Linked:
        """Return the byte code in a file. Raises Unreadable."""
        content = read(place, MOST_FILE)
        with raise_unreadable():
            time_ns = place.stat().st_mtime_ns
        return cls(str(place), _about(place.name, content, time_ns))


def read_tree(cache: Path) -> Tree | None:
    """Return the byte code that is kept in a folder: the files which are as they were written."""
    try:
        digest, _, content = read(cache / TABLE, MOST_TABLE).partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() != digest:
            return None
        with raise_unreadable():
            table = json.loads(content)
            files = {str(name): File(*row) for name, row in table["files"].items()}
            folder = cache / Path(table["folder"]).name
    except Absent:
        return None
    except Unreadable:
        remove_folder(cache / TABLE)  # a folder, in the place of which no file can be put
        return None
    # A machine that went down may have left a file of the right size and time without its content.
    is_intact = _is_untouched if table["boot"] == boot_id() != "" else _is_same
    intact = {name: file for name, file in files.items() if not file.path or is_intact(folder, file)}
    tree = Tree(folder=folder, files=intact, whole=len(intact) == len(files))
    if tree.whole and table["boot"] != boot_id():
        with suppress(OSError):
            _write_table(cache, tree)
    return tree


def write_tree(cache: Path, code: Mapping[str, tuple[str, bytes | Linked]], replaced: Tree | None) -> Tree:
    """Write a new folder of byte code: the path and content of each source's; return it. Raises OSError."""
    if replaced is not None:
        with suppress(OSError):
            os.utime(replaced.folder)  # its day begins now
    folder = Path(tempfile.mkdtemp(prefix=FOLDER, dir=cache))
    try:
        folder.chmod(0o755)
        tree = Tree(folder=folder, files=_fill(folder, code))
        _write_table(cache, tree)
    except BaseException:
        remove_folder(folder)
        raise
    return tree


def _fill(folder: Path, code: Mapping[str, tuple[str, bytes | Linked]]) -> dict[str, File]:
    files, parents = {}, set()
    for name, (path, content) in code.items():
        if not (content.file.path if isinstance(content, Linked) else content):
            files[name] = File("")
            continue
        target, parent = f"{folder}/{path}", path.rpartition("/")[0]  # `Path` would take half of the time
        if parent not in parents:
            os.makedirs(f"{folder}/{parent}", exist_ok=True)  # noqa: PTH103 - as above
            parents.add(parent)
        if isinstance(content, Linked):
            files[name] = _link(content, path, target)
        else:
            files[name] = _written(content, path, target)
    return files


def sweep(cache: Path, tree: Tree | None) -> None:
    """Remove all folders but this one, those that others replaced or killed runs left, once they are a day old."""
    with suppress(OSError):
        with os.scandir(cache) as entries:
            folders = [entry.path for entry in entries if entry.name.startswith((FOLDER, "simmatrix-"))]
        for folder in folders:
            is_old = time.time() - os.stat(folder).st_mtime > DAY  # noqa: PTH116 - before each run
            if is_old and (tree is None or folder != str(tree.folder)):
                remove_folder(Path(folder))


def _link(linked: Linked, path: str, target: str) -> File:
    try:
        os.link(linked.place, target)
        return linked.file._replace(path=path)
    except OSError:  # another disk, or more links than it can have
        return _written(read(linked.place, MOST_FILE), path, target)


def _written(content: bytes, path: str, target: str) -> File:
    with open(target, "wb", buffering=0) as file:  # noqa: PTH123 - thousands of files
        file.write(content)
        there = os.fstat(file.fileno())
    return _about(path, content, there.st_mtime_ns)


def _about(path: str, content: bytes, time_ns: int) -> File:
    return File(path, len(content), time_ns, hashlib.sha256(content).hexdigest(), content[8:16].hex())


def _write_table(cache: Path, tree: Tree) -> None:
    table = {"boot": boot_id(), "folder": tree.folder.name, "files": tree.files}
    content = json.dumps(table).encode("ascii")
    write_atomic(cache / TABLE, hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def _is_untouched(folder: Path, file: File) -> bool:
    try:
        there = os.lstat(f"{folder}/{file.path}")
    except OSError:
        return False
    return (there.st_size, there.st_mtime_ns) == (file.size, file.time)


def _is_same(folder: Path, file: File) -> bool:
    try:
        content = read(folder / file.path, MOST_FILE)
    except Unreadable:
        return False
    return _is_untouched(folder, file) and hashlib.sha256(content).hexdigest() == file.digest


@lru_cache
def boot_id() -> str:
    """Return the name of this start of the machine, empty where the kernel tells none."""
    try:
        return BOOT.read_text()
    except OSError:
        return ""

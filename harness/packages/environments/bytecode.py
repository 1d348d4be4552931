"""Keep the byte code of an environment: each run writes its own, and only code that was compiled apart is kept.

A run may leave anything as byte code, be it by intent or because a disk was full. So it writes into a folder that goes
with it, and only the names of the sources that it needed are taken from there. Before the next run they are compiled
from the sealed environment, in a process that runs nothing of them, and kept in one file under its own hash: what was
damaged since is not used. An environment that has none begins with that of others for the same Python, for those files
which are the very same ones on the disk; and what others needed is compiled before its first run.

What numba and Warp compile cannot be made apart from the run. It is kept for those that import the same.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from harness.machine import process
from harness.machine.files.guarded_files import read
from harness.machine.files.scratch_folders import remove_folder, scratch_folder
from harness.machine.store import own_folders, write_atomic
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable
from harness.model.vocabulary import INCELL

PREFIX = "PYTHONPYCACHEPREFIX"
CODE, NAMES, ORIGIN = "code", "names", "origin"
OWN = f"{INCELL}/"
OTHERS = 4
"""Environments of which byte code is taken, those used last."""

MOST_NAMES, LONGEST_NAME, MOST_CODE = 20_000, 1_000, 1 << 30
DAY = 86_400.0
WORTH = 64_000
"""Bytes of sources: fewer are compiled by the run itself sooner than another Python starts."""

LIMITS = process.Limits(seconds=300.0, memory_mb=2000)

# Of absolute names only the standard library and our own files are compiled: a run could name any of this machine.
COMPILE = """
import importlib.util, json, os, py_compile, sys

listed, made, own, folders = sys.argv[1], sys.argv[2], sys.argv[3], sys.argv[4:]
standard = os.path.dirname(os.path.realpath(os.__file__)) + os.sep
with open(listed, encoding="utf-8") as file:
    names = json.load(file)
table, content = [], []
for name in names:
    places = [os.path.join(folder, name) for folder in folders]
    source = next((place for place in places if os.path.isfile(place)), "")
    if os.path.isabs(name) and not os.path.realpath(name).startswith((standard, own)):
        source = ""
    code = b""
    try:
        py_compile.compile(source, cfile=made, doraise=True)
        with open(made, "rb") as file:
            code = file.read()
    except BaseException:
        pass
    table.append([name, os.path.basename(importlib.util.cache_from_source(source or "x.py")), len(code)])
    content.append(code)
with open(made, "wb") as file:
    file.write(json.dumps(table).encode("ascii") + b"\\n" + b"".join(content))
"""
"""Compiles files: nothing of them is run. Its own Python takes no module from the environment (`-I -S`)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """The environment that byte code belongs to: its folders, its Python, and where its byte code is kept."""

    folders: tuple[Path, ...]
    python: Path
    cache: Path


@dataclass(frozen=True, kw_only=True, slots=True)
class RunFolders:
    """The folders of one run: `prefix` is its own, `compiled` is shared by all runs that import the same."""

    prefix: Path
    compiled: Path

    @property
    def variables(self) -> dict[str, str]:
        """Return the variables by which Python, numba and Warp find them."""
        return {
            PREFIX: str(self.prefix),
            "NUMBA_CACHE_DIR": str(self.compiled / "numba"),
            "WARP_CACHE_PATH": str(self.compiled / "warp"),
        }

    @property
    def writable(self) -> tuple[Path, ...]:
        """Return the folders that a run writes to."""
        return self.prefix, self.compiled


@contextmanager
def lend_folders(source: Source, shown: Path, trust: str) -> Iterator[RunFolders]:
    """Yield a run's folders, filled with the kept byte code of an environment that the run sees at `shown`.

    `trust` is equal for runs that import the same.
    """
    with ExitStack() as stack:
        _swept(source.cache)
        try:
            run, cache = stack.enter_context(scratch_folder(source.cache)), source.cache
        except OSError:  # a cache that nobody may write to: what this run compiles goes with it
            run = cache = stack.enter_context(scratch_folder())
        folders = RunFolders(prefix=run / "pycache", compiled=cache / "compiled" / trust)
        for folder in folders.writable:
            folder.mkdir(parents=True, exist_ok=True)
        code = _grown(source)
        with suppress(OSError):  # without it Python compiles again
            _unpacked(code, folders.prefix, source, shown)
        yield folders
        with suppress(OSError):
            _note(source.cache, set(_needed(folders.prefix, source, shown)) - {*code})


def forget(cache: Path) -> None:
    """Delete all kept byte code of an environment, so that it is compiled anew."""
    with suppress(OSError):
        (cache / CODE).unlink(missing_ok=True)
    forget_compiled(cache)


def forget_compiled(cache: Path) -> None:
    """Delete what runs left compiled, by numba or Warp: Python's own byte code was made apart from them."""
    remove_folder(cache / "compiled")


# --- what is kept ----------------------------------------------------------------------------------------------

Code = Mapping[str, tuple[str, bytes]]
"""A source's name, relative to its environment unless it is of the standard library, to its file's name and content."""


def _grown(source: Source) -> Code:
    """Return the byte code that is kept, with that of sources which the runs before this one needed."""
    stored = _read(source.cache / CODE)
    code = {name: entry for name, entry in (stored or _of_others(source)).items() if _is_current(name, entry[1])}
    needed = _names(source.cache) or ([] if stored else _likely(source))
    missing = sorted({*needed} - {*code})
    if sum(_size(source, name) for name in missing) < WORTH:
        missing = []
    if code == stored and not missing:
        return stored
    with suppress(OSError, Unreadable):
        code = {**code, **(_compiled(source, missing) if missing else {})}
        content = _encoded(code)
        write_atomic(source.cache / CODE, hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
        write_atomic(source.cache / ORIGIN, json.dumps(_origin(source)).encode())
    return code


def _size(source: Source, name: str) -> int:
    """Return the bytes of a source, 0 where there is none."""
    for folder in source.folders:
        with suppress(OSError):
            return os.stat(f"{folder}/{name}" if name[0] != "/" else name).st_size  # noqa: PTH116 - hundreds of files
    return 0


def _is_current(name: str, code: bytes) -> bool:
    """Return whether byte code is of the source as it is now; sources of an environment do not change, ours may."""
    if not name.startswith(OWN):
        return True
    try:
        there = os.stat(name)  # noqa: PTH116 - before each run
    except OSError:
        return False
    mark = b"".join((number & 0xFFFFFFFF).to_bytes(4, "little") for number in (int(there.st_mtime), there.st_size))
    return code[8:16] == mark


def _origin(source: Source) -> list[str]:
    """Return the interpreter below an environment, and its folders."""
    return [str(source.python.resolve()), *map(str, source.folders)]


def _others(source: Source) -> Iterator[tuple[Path, list[str]]]:
    """Yield where other environments have their byte code, and their origins, the newest first."""
    with suppress(OSError):
        files = sorted(source.cache.parent.glob(f"*/{ORIGIN}"), key=lambda file: file.stat().st_mtime, reverse=True)
        origins = ((file.parent, _read_list(file)) for file in files if file.parent != source.cache)
        yield from (one for one in origins if one[1])


def _of_others(source: Source) -> Code:
    """Return byte code of other environments for the same Python: that of files which this one shares with them."""
    code: dict[str, tuple[str, bytes]] = {}
    python, *folders = _origin(source)
    for cache, origin in islice((one for one in _others(source) if one[1][0] == python), OTHERS):
        for name, entry in _read(cache / CODE).items():
            if name not in code and (name.startswith("/") or _is_shared(name, folders, origin[1:])):
                code[name] = entry
    return code


def _likely(source: Source) -> set[str]:
    """Return the sources that runs in other environments needed and that this one has, too, before its first run."""
    ours = _standard_library(source.python.resolve())
    likely = set()
    for cache, origin in islice(_others(source), OTHERS):
        theirs = _standard_library(Path(origin[0]))
        likely |= {ours + name[len(theirs) :] if name.startswith(theirs) else name for name in _names(cache)}
    return {name for name in likely if _size(source, name)}


def _standard_library(python: Path) -> str:
    """Return the folder of the standard library, as the names of its sources begin."""
    return f"{python.parents[1]}/lib/{python.name.removesuffix('d')}/"


def _is_shared(name: str, ours: Iterable[str], theirs: Iterable[str]) -> bool:
    """Return whether two environments have the same file on the disk, by two links, under a name."""
    marks = []
    for folders in (ours, theirs):
        for folder in folders:
            with suppress(OSError):
                there = os.stat(f"{folder}/{name}")  # noqa: PTH116 - hundreds of files
                marks.append((there.st_dev, there.st_ino))
                break
    return len(marks) == 2 and marks[0] == marks[1]


def _read(path: Path) -> Code:
    try:
        digest, _, content = read(path, MOST_CODE).partition(b"\n")
        return _decoded(content) if hashlib.sha256(content).hexdigest().encode() == digest else {}
    except Absent:
        return {}
    except Unreadable:
        remove_folder(path)  # a folder, in the place of which no file can be put
        return {}


def _encoded(code: Code) -> bytes:
    table = [[name, file, len(content)] for name, (file, content) in code.items()]
    return json.dumps(table).encode("ascii") + b"\n" + b"".join(content for _, content in code.values())


def _decoded(content: bytes) -> Code:
    with raise_unreadable():
        start = content.index(b"\n") + 1
        code = {}
        for name, file, size in json.loads(content[:start]):
            # A folder in the file's name could lead out of the run's prefix.
            code[str(name)] = (str(file).rpartition("/")[2], content[start : start + size])
            start += size
        return code


def _compiled(source: Source, names: list[str]) -> Code:
    with scratch_folder(source.cache) as work:
        home, listed, output = work / "home", work / "names", work / "made"
        home.mkdir()
        listed.write_text(json.dumps(names), encoding="utf-8")
        python = (str(source.python), "-I", "-S", "-c", COMPILE)
        process.run(
            process.Command(
                argv=(*python, str(listed), str(output), OWN, *map(str, source.folders)),
                cwd=home,
                env={"PATH": os.defpath},
                limits=LIMITS,
                log=work / "log",
                profile=process.Profile.CELL,
                home=home,
                sealed=source.folders,
                shielded=own_folders(),
                writable=(work,),
            )
        )
        code = _decoded(read(output, MOST_CODE))
    # What cannot be compiled is kept as empty, so that it is not tried again before each run.
    return {name: code.get(name, ("", b"")) for name in names}


# --- what a run has --------------------------------------------------------------------------------------------


def _unpacked(code: Code, prefix: Path, source: Source, shown: Path) -> None:
    parents: set[str] = set()
    for name, (file, content) in code.items():
        if not content:
            continue
        parent = f"{prefix}{_place(name, source, shown).rpartition('/')[0]}"
        if parent not in parents:
            Path(parent).mkdir(parents=True, exist_ok=True)
            parents.add(parent)
        with open(f"{parent}/{file}", "wb", buffering=0) as target:  # noqa: PTH123 - thousands of files
            target.write(content)


def _place(name: str, source: Source, shown: Path) -> str:
    """Return where a run sees a source."""
    if name.startswith("/"):
        return name
    if shown not in source.folders:
        return f"{shown}/{name}"
    holders = (folder for folder in source.folders[:-1] if (folder / name).exists())
    return f"{next(holders, source.folders[-1])}/{name}"


def _needed(prefix: Path, source: Source, shown: Path) -> Iterator[str]:
    """Yield the names of the sources that a run compiled; what it left there is not looked into."""
    for path in _pyc_files(str(prefix)):
        original = path[len(str(prefix)) :].removesuffix(".pyc").rpartition(".")[0] + ".py"
        holders = (folder for folder in (shown, *source.folders) if original.startswith(f"{folder}/"))
        holder = next(holders, None)
        yield original if holder is None else original[len(f"{holder}/") :]


def _pyc_files(folder: str) -> Iterator[str]:
    """Yield the paths of byte code below a folder in which anything may lie."""
    waiting, seen = [folder], 0
    while waiting and seen < MOST_NAMES:
        with suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                seen += 1
                if len(entry.path) > LONGEST_NAME:
                    continue
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)
                elif entry.name.endswith(".pyc"):
                    yield entry.path


def _note(cache: Path, names: Iterable[str]) -> None:
    """Write down what is to be compiled before the next run."""
    new = sorted({*names} - {*_names(cache)})
    if new:
        every = [*_names(cache), *new][:MOST_NAMES]
        write_atomic(cache / NAMES, json.dumps(every).encode())


def _names(cache: Path) -> list[str]:
    return [name for name in _read_list(cache / NAMES) if os.path.normpath(name) == name and name[:2] != ".."]


def _read_list(path: Path) -> list[str]:
    try:
        with raise_unreadable():
            content = json.loads(read(path, MOST_NAMES * LONGEST_NAME))
    except Unreadable:
        return []
    return [text for text in content if isinstance(text, str)] if isinstance(content, list) else []


def _swept(cache: Path) -> None:
    """Remove the folders that killed runs left behind, once these are a day old."""
    cache.mkdir(parents=True, exist_ok=True)
    for folder in cache.glob("simmatrix-*"):
        with suppress(OSError):
            if time.time() - folder.stat().st_mtime > DAY:
                remove_folder(folder)

"""Keep the byte code of an environment: each run writes its own, and only code that was compiled apart is kept.

A run may leave anything as byte code, be it by intent or because a disk was full. So what it writes goes with it, and
only the names of the sources that it needed are taken from there. Before the next run they are compiled from the sealed
environment, in a process that runs nothing of them, and kept (`bytecode_tree`). That of the standard library is taken
from the interpreter, to whose library no run can write. A run sees all of it below a layer that takes its writes, or,
where this machine has none, as a copy. An environment that has no code begins with that of others
for the same Python, for those files which are the very same ones on the disk; and what others needed is compiled before
its first run.

What numba and Warp compile cannot be made apart from the run. It is kept for those that import the same.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Lock

from msgspec import Struct

from harness.machine import process
from harness.machine.files.guarded_files import read
from harness.machine.files.scratch_folders import remove_folder, scratch_folder
from harness.machine.store import cache_folder, own_folders, write_atomic
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.model.vocabulary import INCELL
from harness.packages.environments import first_sources
from harness.packages.environments.bytecode_tree import TABLE, File, Linked, Tree, read_tree, sweep, write_tree

PREFIX = "PYTHONPYCACHEPREFIX"
FOLDER, NAMES, ORIGIN = "pycache", "names", "origin"
OWN = f"{INCELL}/"
OTHERS = 4
"""Environments of which byte code is taken, those used last."""

MOST_NAMES, LONGEST_NAME, MOST_CODE = 20_000, 1_000, 1 << 30
WORTH = 64_000
"""Bytes of sources: fewer are compiled by the run itself sooner than another Python starts."""

LIMITS = process.Limits(seconds=300.0, memory_mb=2000)

# Of absolute names only the standard library and our own files are compiled: a run could name any of this machine.
COMPILE = """
import importlib.util, json, marshal, os, sys

listed, made, own, trusting, folders = *sys.argv[1:5], sys.argv[5:]
head = importlib.util.MAGIC_NUMBER + bytes(4)
def number(value):
    return (int(value) & 0xFFFFFFFF).to_bytes(4, "little")
standard = os.path.dirname(os.path.realpath(os.__file__)) + os.sep
with open(listed, encoding="utf-8") as file:
    names = json.load(file)
table, content = [], []
def is_kept(path, start):
    try:
        with open(path, "rb") as file:
            return file.read(len(start)) == start
    except OSError:
        return False
for name in names:
    places = [os.path.join(folder, name) for folder in folders]
    source = next((place for place in places if os.path.isfile(place)), "")
    real = os.path.realpath(name)
    if os.path.isabs(name) and not real.startswith((standard, own)):
        source = ""
    code, size, path = b"", 0, importlib.util.cache_from_source(source or "x.py")
    try:
        with open(source, "rb") as file:
            there = os.fstat(file.fileno())
            start = head + number(there.st_mtime) + number(there.st_size)
            if trusting and os.path.isabs(name) and real.startswith(standard) and is_kept(path, start):
                size = -1
            else:
                code = start + marshal.dumps(compile(file.read(), source, "exec", dont_inherit=True))
                size = len(code)
    except BaseException:
        code, size = b"", 0
    table.append([name, os.path.basename(path), size])
    content.append(code)
with open(made, "wb") as file:
    file.write(json.dumps(table).encode("ascii") + b"\\n" + b"".join(content))
"""
"""Compiles files: nothing of them is run. Its own Python takes no module from the environment (`-I -S`).

It writes a table of (name, file of byte code, size) and then the byte code. A size of -1 says that the interpreter
keeps byte code of this source of its library beside it.
"""


class Source(Struct, frozen=True, kw_only=True):
    """The environment that byte code belongs to: its folders, its Python, and where its byte code is kept."""

    folders: tuple[Path, ...]
    python: Path
    cache: Path


def shielded(python: Path) -> tuple[Path, ...]:
    """Return the folders that no run may write to: the harness's own, and the library of the interpreter."""
    library = Path(first_sources.libraries(python.resolve())[0])
    return (*own_folders(), library) if library.is_dir() else own_folders()


class RunFolders(Struct, frozen=True, kw_only=True):
    """The folders of one run: `prefix` has its byte code, `compiled` is shared by all runs that import the same.

    With `covered` the prefix is what is kept, and the run has to cover it with a layer.
    """

    prefix: Path
    compiled: Path
    covered: bool = False

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
        return (self.compiled,) if self.covered else (self.prefix, self.compiled)


@contextmanager
def lend_folders(source: Source, shown: Path, trust: str, *, covered: bool = False) -> Iterator[RunFolders]:
    """Yield a run's folders, with the kept byte code of an environment that the run sees at `shown`.

    `trust` is equal for runs that import the same. With `covered` the run is lent what is kept, if there is any, and
    `note` is to be told what it wrote over it.
    """
    with suppress(OSError):
        source.cache.mkdir(parents=True, exist_ok=True)
    tree = _grown(source)
    sweep(source.cache, tree)
    compiled = source.cache / "compiled" / trust
    if covered and tree is not None and _is_made(compiled):
        yield RunFolders(prefix=tree.folder, compiled=compiled, covered=True)
        return
    with ExitStack() as stack:
        try:
            run, cache = stack.enter_context(scratch_folder(source.cache)), source.cache
        except OSError:  # a cache that nobody may write to: what this run compiles goes with it
            run = cache = stack.enter_context(scratch_folder())
        folders = RunFolders(prefix=run / "pycache", compiled=cache / "compiled" / trust)
        for folder in folders.writable:
            folder.mkdir(parents=True, exist_ok=True)
        if tree is not None:
            with suppress(OSError):  # without it Python compiles again
                _copy(tree, folders.prefix, source, shown)
        before = {*_pyc_files(folders.prefix)}
        yield folders
        note(source, (path for path in _pyc_files(folders.prefix) if path not in before), shown)


def compile_ahead(source: Source) -> None:
    """Compile what the first run of an environment will probably need.

    Environments of one Python come one after the other, as the second one takes what it shares from the first.
    """
    with _turns.setdefault(source.python.resolve(), Lock()), suppress(OSError):
        source.cache.mkdir(parents=True, exist_ok=True)
        _grown(source)


_turns: dict[Path, Lock] = {}


def note(source: Source, compiled: Iterable[str], shown: Path | None = None) -> None:
    """Write down the sources of the byte code that a run wrote, given by paths below the prefix.

    The run saw the environment at `shown`, if not in its own place.
    """
    names = {_source_of(path, source, shown or source.folders[-1]) for path in compiled}
    with suppress(OSError):
        new = sorted(names - {*_names(source.cache)}) if names else []
        if new:
            every = [*_names(source.cache), *new][:MOST_NAMES]
            write_atomic(source.cache / NAMES, json.dumps(every).encode())


def forget(cache: Path) -> None:
    """Delete all kept byte code of an environment, so that it is compiled anew."""
    with suppress(OSError):
        (cache / TABLE).unlink(missing_ok=True)
    forget_compiled(cache)


def forget_compiled(cache: Path) -> None:
    """Delete what runs left compiled, by numba or Warp: Python's own byte code was made apart from them."""
    remove_folder(cache / "compiled")


# --- what is kept ----------------------------------------------------------------------------------------------


def _grown(source: Source) -> Tree | None:
    """Return the byte code that is kept, with that of sources which the runs before this one needed."""
    tree = read_tree(source.cache)
    files = tree.files if tree else {}
    needed = _names(source.cache) or ([] if tree else _likely(source))
    current = {name for name, file in files.items() if _is_current(name, file)}
    if tree and tree.whole and len(current) == len(files) and not _is_worth(source, {*needed} - current):
        return tree
    links = {name: Linked(f"{tree.folder}/{files[name].path}", files[name]) for name in current} if tree else {}
    links = links or _of_others(source)
    code: dict[str, tuple[str, bytes | Linked]] = {}
    for name, linked in links.items():
        code[name] = (_path(name, linked.file.path, source), linked)
    missing = sorted({*needed} - {*code})
    with suppress(OSError, Unreadable):
        if _is_worth(source, missing):
            for name, (file, content) in _compiled(source, missing).items():
                code[name] = (_path(name, file, source), content)
        if code:
            tree = write_tree(source.cache, code, tree)
            write_atomic(source.cache / ORIGIN, json.dumps(_origin(source)).encode())
    return tree if tree and tree.whole else None


def _path(name: str, file: str, source: Source) -> str:
    """Return where the byte code of a source lies below the prefix, of which `file` is the path elsewhere."""
    place = _place(name, source, source.folders[-1])
    return f"{place.rpartition('/')[0]}/{file.rpartition('/')[2]}".lstrip("/")


def _is_worth(source: Source, missing: Iterable[str]) -> bool:
    """Return whether sources are large enough that another Python is to compile them."""
    return sum(_size(source, name) for name in missing) >= WORTH


def _is_made(folder: Path) -> bool:
    """Return whether a folder could be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return True


def _size(source: Source, name: str) -> int:
    """Return the bytes of a source, 0 where there is none."""
    for folder in source.folders:
        with suppress(OSError):
            return os.stat(f"{folder}/{name}" if name[0] != "/" else name).st_size  # noqa: PTH116 - hundreds of files
    return 0


def _is_current(name: str, file: File) -> bool:
    """Return whether byte code is of the source as it is now; sources of an environment do not change, ours may."""
    if not name.startswith(OWN):
        return True
    try:
        there = os.stat(name)  # noqa: PTH116 - before each run
    except OSError:
        return False
    mark = b"".join((number & 0xFFFFFFFF).to_bytes(4, "little") for number in (int(there.st_mtime), there.st_size))
    return file.mark == mark.hex()


def _origin(source: Source) -> list[str]:
    """Return the interpreter below an environment, and its folders."""
    return [str(source.python.resolve()), *map(str, source.folders)]


def _others(source: Source) -> Iterator[tuple[Path, list[str]]]:
    """Yield where other environments have their byte code, and their origins, the newest first."""
    with suppress(OSError):
        files = sorted(source.cache.parent.glob(f"*/{ORIGIN}"), key=lambda file: file.stat().st_mtime, reverse=True)
        origins = ((file.parent, _read_list(file)) for file in files if file.parent != source.cache)
        yield from (one for one in origins if one[1])


def _of_others(source: Source) -> dict[str, Linked]:
    """Return byte code of other environments for the same Python: that of files which this one shares with them."""
    code: dict[str, Linked] = {}
    python, *folders = _origin(source)
    for cache, origin in islice((one for one in _others(source) if one[1][0] == python), OTHERS):
        tree = read_tree(cache)
        for name, file in tree.files.items() if tree else ():
            shared = name.startswith("/") or _is_shared(name, folders, origin[1:])
            if tree and name not in code and shared and _is_current(name, file):
                code[name] = Linked(f"{tree.folder}/{file.path}", file)
    return code


def _likely(source: Source) -> set[str]:
    """Return the sources that a first run probably needs: those of runs elsewhere, where this environment has them."""
    python = source.python.resolve()
    ours, likely = first_sources.libraries(python), first_sources.load(python, partial(_size, source))
    for cache, origin in islice(_others(source), OTHERS):
        theirs = first_sources.libraries(Path(origin[0]))
        likely |= {_translate(name, theirs, ours) for name in _names(cache)}
    return {name for name in likely if _size(source, name)}


def _translate(name: str, theirs: Iterable[str], ours: Iterable[str]) -> str:
    """Return the name that a source of one Python has with another one."""
    for their, our in zip(theirs, ours, strict=True):
        if name.startswith(their):
            return our + name[len(their) :]
    return name


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


def _compiled(source: Source, names: list[str]) -> dict[str, tuple[str, bytes | Linked]]:
    """Return the path and byte code of sources; of the standard library that which the interpreter keeps beside it."""
    with scratch_folder(source.cache) as work:
        home, listed, output = work / "home", work / "names", work / "made"
        home.mkdir()
        listed.write_text(json.dumps(names), encoding="utf-8")
        python = (str(source.python), "-I", "-S", "-c", COMPILE)
        # Where nothing keeps a run from the library of its interpreter, its byte code may be anybody's.
        trusting = "yes" if process.sandbox_mode() != process.UNSEALED else ""
        process.run(
            process.Command(
                argv=(*python, str(listed), str(output), OWN, trusting, *map(str, source.folders)),
                cwd=home,
                env={"PATH": os.defpath},
                limits=LIMITS,
                log=work / "log",
                profile=process.Profile.CELL,
                home=home,
                sealed=source.folders,
                shielded=shielded(source.python),
                writable=(work,),
            )
        )
        code = _decoded(read(output, MOST_CODE))
    # What cannot be compiled is kept as empty, so that it is not tried again before each run.
    return {name: code.get(name, ("", b"")) for name in names}


def _decoded(content: bytes) -> dict[str, tuple[str, bytes | Linked]]:
    with raise_unreadable():
        start = content.index(b"\n") + 1
        code: dict[str, tuple[str, bytes | Linked]] = {}
        for name, file, size in json.loads(content[:start]):
            code[str(name)] = (str(file), content[start : start + size] if size >= 0 else _beside(str(name), str(file)))
            start += max(0, size)
        return code


def _beside(name: str, file: str) -> Linked:
    """Return the byte code that an interpreter keeps of a source of its library. Raises Unreadable."""
    return Linked.to(Path(name).parent / "__pycache__" / Path(file).name)


# --- what a run has --------------------------------------------------------------------------------------------


def _copy(tree: Tree, prefix: Path, source: Source, shown: Path) -> None:
    for name, file in tree.files.items():
        if file.path:
            target = Path(f"{prefix}{_place(name, source, shown)}").with_name(Path(file.path).name)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(tree.folder / file.path, target)


def _place(name: str, source: Source, shown: Path) -> str:
    """Return where a run sees a source."""
    if name.startswith("/"):
        return name
    if shown not in source.folders:
        return f"{shown}/{name}"
    holders = (folder for folder in source.folders[:-1] if (folder / name).exists())
    return f"{next(holders, source.folders[-1])}/{name}"


def _source_of(path: str, source: Source, shown: Path) -> str:
    """Return the name of the source of byte code, whose path below the prefix is given; nothing is looked at."""
    original = "/" + path.lstrip("/").removesuffix(".pyc").rpartition(".")[0] + ".py"
    holders = (folder for folder in (shown, *source.folders) if original.startswith(f"{folder}/"))
    holder = next(holders, None)
    return original if holder is None else original[len(f"{holder}/") :]


def _pyc_files(prefix: Path) -> Iterator[str]:
    """Yield the paths of byte code below a folder in which anything may lie, relative to it."""
    waiting, seen = [str(prefix)], 0
    while waiting and seen < MOST_NAMES:
        with suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                seen += 1
                if len(entry.path) > LONGEST_NAME:
                    continue
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)
                elif entry.name.endswith(".pyc"):
                    yield entry.path[len(str(prefix)) :]


def _names(cache: Path) -> list[str]:
    return [name for name in _read_list(cache / NAMES) if os.path.normpath(name) == name and name[:2] != ".."]


def _read_list(path: Path) -> list[str]:
    try:
        with raise_unreadable():
            content = json.loads(read(path, MOST_NAMES * LONGEST_NAME))
    except Unreadable:
        return []
    return [text for text in content if isinstance(text, str)] if isinstance(content, list) else []


def main() -> None:
    """Write what the runs of a package needed, which are those of this cache, into the list of first sources."""
    origins = list((cache_folder() / FOLDER).glob(f"*/{ORIGIN}"))
    first_sources.write(sys.argv[1], ((Path(_read_list(file)[0]), _names(file.parent)) for file in origins))


if __name__ == "__main__":
    main()

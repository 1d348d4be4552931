"""Compute digests of our own code, for results that only the same code would produce again.

Which files belong to a module is read from what they import, so that no list of them is kept by hand. Comments count:
to tell them from code would take longer than what the digest saves.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

PACKAGE = Path(__file__).parent.parent
IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(harness[\w.]*|\.[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]+)|import[ \t]+(harness\.[\w.]+))",
    re.MULTILINE,
)


@cache
def digest(module: str) -> str:
    """Return a digest of the sources of a module and of all our modules that it imports, directly or not."""
    combined = hashlib.sha256()
    for name, path in sorted(imported_files(module).items()):
        combined.update(name.encode() + b"\0" + path.read_bytes() + b"\0" + _data(path) + b"\0")
    return combined.hexdigest()[:32]


@cache
def stat_files() -> tuple[tuple[str, int, int], ...]:
    """Return the path, size and time of change (nanoseconds) of each file of our package, byte code apart."""
    files, waiting = [], [str(PACKAGE)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                if entry.name == "__pycache__":
                    continue
                if entry.is_dir():
                    waiting.append(entry.path)
                else:
                    there = entry.stat()
                    files.append((entry.path, there.st_size, there.st_mtime_ns))
    return tuple(sorted(files))


def imported_files(module: str) -> dict[str, Path]:
    """Return the files of a module and of all our modules that it imports, directly or not, by module name."""
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _file(name)
        if path and name not in files:
            files[name] = path
            package = name if path.name == "__init__.py" else name.rpartition(".")[0]
            # Python runs the `__init__` of every package above a module, so those count, too.
            waiting += [package, name.rpartition(".")[0], *_imports(path.read_text(encoding="utf-8"), package)]
    return files


def _data(path: Path) -> bytes:
    """Return the data of a module, a file of its name beside it."""
    beside = path.with_suffix(".toml")
    return beside.read_bytes() if beside.is_file() else b""


def _file(name: str) -> Path | None:
    place = PACKAGE.parent / name.replace(".", "/")
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if name and path.is_file()), None)


def _imports(text: str, package: str) -> Iterator[str]:
    """Yield names that may be modules, as a module of this package has them: of `from a import b` `a` and `a.b`."""
    for given, names, plain in IMPORT.findall(text):
        place = resolve_name(given, package) if given.startswith(".") else given or plain
        yield place
        for name in re.findall(r"(\w+)(?:[ \t]+as[ \t]+\w+)?", re.sub(r"#[^\n]*", "", names)):
            yield f"{place}.{name}"

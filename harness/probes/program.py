"""Tell which in-cell files a check runs, and digest what they do.

A check has a file of its own, `check_` and its name. Its digest covers that file, the adapter, all that they import,
and what the runner itself imports; of each the syntax tree, so that a changed comment or docstring changes nothing.
The transport only carries a request in and records out. It enters by the number `PROTOCOL` alone.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from threading import Lock

import msgspec
from msgspec import Struct

from harness.machine import store
from harness.model import decoding
from harness.model.vocabulary import INCELL
from harness.probes import syntax
from harness.standalone import adapters

TRANSPORT = ("bootstrap.py", "cell_originals.py", "cell_records.py", "cell_run.py")
"""The files that carry requests and records and measure nothing. A probe enters by the first, which runs the last."""

PROTOCOL = 2
"""The number of the transport: another one measures everything anew."""

TRANSPORT_DIGEST = "a4cfbb9e6e4237e70721221ed9fbea45"
"""The transport's source that the number stands for; see `transport_digest`."""


class File(msgspec.Struct, frozen=True):
    """One in-cell file: what it does, and the files that it imports."""

    digest: str
    imports: tuple[str, ...]


class Program(Struct, frozen=True):
    """The in-cell files of one folder, by name."""

    files: Mapping[str, File]

    def loaded(self, api: str, checks: Iterable[str]) -> tuple[str, ...]:
        """Return the files that a process loads for these checks, sorted."""
        return self._closure([*TRANSPORT, *_adapter(api), *map(check_file, checks)])

    def digest(self, api: str, check: str) -> str:
        """Digest what this check does with this adapter."""
        return self._digest(self.loaded(api, (check,)))

    def phase_digest(self, api: str, phase: str) -> str:
        """Digest what all checks of a phase do with this adapter."""
        checks = [name for name in self.files if name.startswith(check_file(phase).replace(".py", "_"))]
        return self._digest(self._closure([*TRANSPORT, *_adapter(api), *checks]))

    def transport_digest(self) -> str:
        """Digest what the transport does."""
        return store.digest([(name, self.files[name].digest) for name in TRANSPORT])

    def _digest(self, names: Iterable[str]) -> str:
        return store.digest(PROTOCOL, [(name, self.files[name].digest) for name in names if name not in TRANSPORT])

    def _closure(self, names: Iterable[str]) -> tuple[str, ...]:
        waiting, closure = list(names), set[str]()
        while waiting:
            name = waiting.pop()
            if name not in closure:
                closure.add(name)
                waiting += self.files[name].imports
        return tuple(sorted(closure))


def check_file(check: str) -> str:
    """Return the name of the file of a check, as the runner finds it."""
    return f"check_{check.replace('.', '_')}.py"


@cache
def digest(api: str, check: str) -> str:
    """Digest what a check does with an adapter, `""` for none: part of a result's key."""
    return own().digest(api, check)


def own() -> Program:
    """Return the in-cell program of this installation. One thread reads it, however many ask."""
    with _reading:
        return _own()


@cache
def _own() -> Program:
    return read(INCELL)


_reading = Lock()


def read(folder: Path) -> Program:
    """Read the in-cell files of a folder; what they do is remembered, as parsing all of them costs 0.15 s."""
    sources = {path.name: path.read_bytes() for path in sorted(folder.glob("*.py"))}
    marks = {name: hashlib.sha256(source).hexdigest() for name, source in sources.items()}
    # The reader is part of the mark: another way of digesting gives other digests for the same sources.
    marks["how"] = hashlib.sha256(Path(syntax.__file__).read_bytes() + repr(adapters.NAMES).encode()).hexdigest()

    def parsed() -> bytes:
        return msgspec.json.encode({name: _file(name, source) for name, source in sources.items()})

    return Program(store.load_or_make("program", repr(marks), parsed, decoding.decoder(dict[str, File]).decode))


def _file(name: str, source: bytes) -> File:
    """Describe one file: its digest and its imports. The declarations of an adapter are not part of the digest.

    They change how a result is judged, and nothing that is measured. A file that is no valid Python, which its cell
    will report, counts byte by byte.
    """
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return File(hashlib.sha256(source).hexdigest()[:32], ())
    declared = adapters.NAMES if name.startswith(adapters.PREFIX) else ()
    return File(syntax.digest(tree, declared), syntax.neighbours(tree))


def _adapter(api: str) -> list[str]:
    return [f"api_{api}.py"] if api else []

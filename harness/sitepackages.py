"""What lies in an environment, read from the metadata in its site-packages without running it."""

from __future__ import annotations

import base64
import csv
import hashlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from importlib.metadata import Distribution, distributions
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version


def versions(path: Path) -> dict[str, str]:
    """Which packages an environment has: name to version."""
    return dict(sorted((canonicalize_name(one.name), plain(one.version)) for one in packages(path)))


def modules(path: Path) -> dict[str, tuple[str, ...]]:
    """The top-level modules of each package, as its RECORD lists files: name to modules, sorted."""
    return {canonicalize_name(one.name): _top_level(one) for one in packages(path)}


def requiring(path: Path, name: str) -> tuple[str, ...]:
    """The packages that declare, in whatever extra, that they need this one."""
    return tuple(sorted({asker for asker, need in _needs(path) if canonicalize_name(need.name) == name}))


def unheld(path: Path) -> tuple[tuple[str, str], ...]:
    """What packages require that is not there, extras apart: who asks, and the requirement."""
    here = versions(path)
    return tuple(
        (asker, str(need))
        for asker, need in _needs(path)
        if canonicalize_name(need.name) not in here and "extra" not in str(need.marker or "")
    )


def changed(path: Path) -> tuple[str, ...]:
    """Compare every file with its RECORD; return those that changed or are gone, relative to the environment."""
    return tuple(sorted(name for one in packages(path) for name in _changed(one, path)))


def packages(path: Path) -> Iterable[Distribution]:
    """All that is installed, as the standard library sees it."""
    return distributions(path=[str(folder) for folder in folders(path)])


def folders(path: Path) -> Iterator[Path]:
    """The site-packages of an environment: one."""
    return path.glob("lib/python*/site-packages")


def plain(version: str) -> str:
    """A version in its normal form, where it is one."""
    try:
        return str(Version(version))
    except InvalidVersion:
        return version


def _needs(path: Path) -> Iterator[tuple[str, Requirement]]:
    """Who requires what; a line of which uv makes something else than it says, being wrong, says nothing."""
    for one in packages(path):
        asker = canonicalize_name(one.name)  # which is read from a file each time
        for line in one.requires or ():
            with suppress(InvalidRequirement):
                yield asker, Requirement(line)


def _top_level(one: Distribution) -> tuple[str, ...]:
    tops = {file.parts[0].partition(".")[0] for file in one.files or () if file.suffix in {".py", ".so"}}
    return tuple(sorted(name for name in tops if name.isidentifier() and not name.startswith("_")))


def _changed(distribution: Distribution, environment: Path) -> Iterator[str]:
    for name, mark, _ in csv.reader((distribution.read_text("RECORD") or "").splitlines()):
        method, _, wanted = mark.partition("=")
        if not wanted:
            continue
        path = Path(str(distribution.locate_file(name)))
        found = path.is_file() and base64.urlsafe_b64encode(hashlib.new(method, path.read_bytes()).digest())
        if not found or found.decode().rstrip("=") != wanted:
            yield path.resolve().relative_to(environment.resolve()).as_posix()

"""Read uv.lock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import msgspec
from packaging.markers import InvalidMarker, Marker, UndefinedComparison, UndefinedEnvironmentName

from harness.model import schema
from harness.packages.requirement_files.entry import Inputs, Parsed, Source, check_number, quote, requirement, where_in


class _Package(msgspec.Struct, frozen=True, kw_only=True, rename="kebab"):
    name: str
    version: str | None = None
    source: dict[str, Any] = {}
    resolution_markers: tuple[str, ...] = ()


class _Lock(msgspec.Struct, frozen=True, kw_only=True, rename="kebab"):
    version: int
    requires_python: str | None = None
    package: tuple[_Package, ...] = ()


def uv_lock(text: str, source: Source) -> Parsed:
    """Read a lock: each package pinned to its version; the project itself and what is no release stay out.

    Of a package that is locked in several versions, the one for this machine's Python is taken.
    """
    lock = schema.load_toml(text, _Lock, source.name)
    check_number(len(lock.package), source)
    counts = Counter(package.name for package in lock.package if _is_for_here(package))
    inputs = Inputs(python=lock.requires_python)
    for package in lock.package:
        where = where_in(text, rf"name\s*=\s*{quote(package.name)}", source)
        if package.source.keys() & {"virtual", "editable", "directory"} or not _is_for_here(package):
            continue
        reason = next(_unreadable(package, counts[package.name]), None)
        if reason:
            inputs += Inputs(not_modelled=(f"{where}: {package.name}: {reason}",))
        else:
            inputs += requirement(f"{package.name}=={package.version}", source, where)
        if package.resolution_markers:
            note = f"{where}: {package.name}: the version for this machine's Python was taken of those that are locked"
            inputs += Inputs(notes=(note,))
    return Parsed(inputs=inputs)


def _is_for_here(package: _Package) -> bool:
    """Return whether a version is locked for this machine's Python; one whose marker cannot be read is."""
    try:
        return not package.resolution_markers or any(Marker(text).evaluate() for text in package.resolution_markers)
    except (InvalidMarker, UndefinedComparison, UndefinedEnvironmentName):
        return True


def _unreadable(package: _Package, versions: int) -> Iterator[str]:
    if package.source.keys() & {"git", "url", "path"}:
        yield "it comes from an address, which no index knows"
    if package.version is None:
        yield "the lock names no version of it"
    if versions > 1:
        yield f"{versions} versions of it are locked"

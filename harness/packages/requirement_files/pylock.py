"""Read pylock.toml."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from packaging.pylock import Package, Pylock, PylockValidationError

from harness.model import replace, schema
from harness.model.errors import BadInput
from harness.packages.requirement_files.entry import Inputs, Parsed, Source, check_number, quote, requirement, where_in


def pylock(text: str, source: Source, extras: Iterable[str], groups: Iterable[str]) -> Parsed:
    """Read a lock: each package pinned to its version, with its marker."""
    table = schema.toml_table(text, source.name)
    try:
        lock = Pylock.from_dict(table)
    except PylockValidationError as error:
        message = f"{source.name}: {error}"
        raise BadInput(message) from None
    chosen = {"extras": frozenset(extras), "dependency_groups": frozenset((*(lock.default_groups or ()), *groups))}
    inputs = Inputs(
        python=str(lock.requires_python) if lock.requires_python else None,
        notes=(f"{source.name}: packages are pinned to its versions, its files and hashes are not asked for",),
    )
    check_number(len(lock.packages), source)
    for package in lock.packages:
        where = where_in(text, rf"name\s*=\s*{quote(package.name)}", source)
        inputs += _locked(package, chosen, source, where)
    return Parsed(inputs=inputs, extras=tuple(lock.extras or ()), groups=tuple(lock.dependency_groups or ()))


def _locked(package: Package, chosen: Mapping[str, frozenset[str]], source: Source, where: str) -> Inputs:
    marker = package.marker
    notes: tuple[str, ...] = ()
    # Only lock files have markers on extras and groups; a requirement cannot carry them on.
    if marker is not None and re.search(r"\b(extras|dependency_groups)\b", str(marker)):
        if not marker.evaluate(dict(chosen), context="lock_file"):
            return Inputs()
        notes = (f"{where}: {package.name}: its marker was judged for this machine's Python: {marker}",)
        marker = None
    tail = f" ; {marker}" if marker else ""
    if package.version is not None and not package.is_direct:
        return Inputs(requirements=(f"{package.name}=={package.version}{tail}",), notes=notes)
    if package.vcs is not None:
        address = f"{package.vcs.type}+{package.vcs.url or package.vcs.path}"
    else:
        direct = package.archive or package.directory
        address = str(getattr(direct, "url", None) or getattr(direct, "path", None))
    return replace(requirement(f"{package.name} @ {address}{tail}", source, where), notes=notes)

"""Make the table of import names: which package brings a module, by the files of its releases."""

from __future__ import annotations

import gzip
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from harness.history import api_history
from harness.history.api_history import ApiHistory
from harness.history.package_plan import Plan

FILE = "imports.json.gz"

USUAL = 5
"""A module that fewer than one in so many releases have got into them by mistake, unless the newest has it."""


class ImportTable(msgspec.Struct, frozen=True, kw_only=True):
    """The package of each import name; `gone` are those that its newest release lacks. `searched` are the plan's."""

    imports: dict[str, str]
    gone: tuple[str, ...]
    searched: tuple[str, ...]


def encode(plan: Plan, histories: Path) -> bytes:
    """Return the file of the table, from the histories in a folder.

    Of several packages with one name, the first of the plan has it.
    """
    imports: dict[str, str] = {}
    taken: set[str] = set()
    gone: set[str] = set()
    for package in plan.all_packages():
        file = histories / f"{package}.json.gz"
        if file.is_file():
            modules = usual_modules(api_history.decode(file.read_bytes()))
            names = [name for name in import_names(modules) if name not in taken]
            imports |= dict.fromkeys(names, package)
            gone |= {name for name in names if modules[name] < max(modules.values())}
            taken |= {*modules}
    table = ImportTable(imports=imports, gone=tuple(sorted(gone)), searched=plan.searched)
    return gzip.compress(msgspec.json.encode(table, order="sorted"), mtime=0)


def usual_modules(history: ApiHistory) -> dict[str, int]:
    """Return the last release of each module, without what got into a few files by mistake.

    A top-level module counts that the newest release has, or one in five.
    """
    read = [place for place, release in enumerate(history.releases) if release.read]
    having: dict[str, set[int]] = {}
    for module, spans in history.modules.items():
        places = {place for place in read if any(first <= place <= last for first, last in spans)}
        having.setdefault(module.partition(".")[0], set()).update(places)
    usual = {top for top, places in having.items() if read[-1] in places or len(places) * USUAL >= len(read)}
    last = {module: max(last for _, last in spans) for module, spans in history.modules.items()}
    return {module: place for module, place in last.items() if module.partition(".")[0] in usual}


def import_names(modules: Mapping[str, int]) -> Iterator[str]:
    """Yield the names that a package brings, from its modules and the last release that has each.

    They are its top-level modules; of a namespace, which others fill as well, those in it.
    """
    newest: dict[str, int] = {}
    below: dict[str, set[str]] = {}
    for module, last in modules.items():
        parts = module.split(".")
        for length in range(1, len(parts) + 1):
            name = ".".join(parts[:length])
            newest[name] = max(newest.get(name, 0), last)
            below.setdefault(".".join(parts[: length - 1]), set()).add(name)
    waiting = sorted(below.get("", ()))
    while waiting:
        name = waiting.pop(0)
        if name in modules and modules[name] == newest[name]:
            yield name
        else:
            waiting += sorted(below.get(name, ()))

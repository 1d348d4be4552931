"""Read the library of each Python of this machine, as releases of a package."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
from packaging.version import Version

from harness.history import release_runner
from harness.history.api_history import MeasuredRelease, ReleaseEntry
from harness.history.release_reader import NATIVE, ReleaseFacts
from harness.machine import interpreters

PACKAGE = "python-library"
"""The name of the history; no package of an index has it."""

RELEASED = {
    "3.6": "2016-12-23", "3.7": "2018-06-27", "3.8": "2019-10-14", "3.9": "2020-10-05", "3.10": "2021-10-04",
    "3.11": "2022-10-24", "3.12": "2023-10-02", "3.13": "2024-10-07", "3.14": "2025-10-07",
}  # fmt: skip
"""The day of each version: PEP 494, 537, 569, 596, 619, 664, 693, 719 and 745."""

PASSED_OVER = frozenset(
    [
        "antigravity",
        "ensurepip",
        "idlelib",
        "pydoc_data",
        "site-packages",
        "test",
        "tests",
        "this",
        "turtle",
        "turtledemo",
    ]
)
"""Folders and modules that are no part of the library, or that do something when they are imported."""

Names = Mapping[str, tuple[str, ...]]
"""Names by the module or class that has them."""


def read() -> list[MeasuredRelease]:
    """Return what each minor version offers, oldest first: its modules, and the names in which the versions differ."""
    newest = {
        ".".join(each.version.split(".")[:2]): each.path
        for each in sorted(interpreters.available(), key=lambda each: Version(each.version))
    }
    facts = {version: _facts(python) for version, python in newest.items() if version in RELEASED}
    return [
        MeasuredRelease(
            entry=ReleaseEntry(version=version, uploaded=RELEASED[version], read=True),
            facts=msgspec.structs.replace(
                each,
                names=_differing([other.names for other in facts.values()], each.names),
                members=_differing([other.members for other in facts.values()], each.members),
            ),
        )
        for version, each in facts.items()
    ]


def _facts(python: str) -> ReleaseFacts:
    """Return the modules of a Python and their names. Raises ValueError if they cannot be read."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "release"
        folder.mkdir()
        modules = sorted({*_modules(Path(python).resolve())})
        answers = release_runner.describe(folder, python, modules)
    if answers is None:
        message = f"{python}: its library could not be imported"
        raise ValueError(message)
    # The names of a module that cannot be imported here are unknown: another machine may have them.
    names = {module: tuple(names) for module, names in answers["names"].items() if module in modules}
    members = {path: tuple(names) for path, names in answers["members"].items()}
    return ReleaseFacts(modules=tuple(modules), names=names, members=members)


def _modules(python: Path) -> Iterator[str]:
    """Yield the modules in the folder of a Python's library."""
    root = next(python.parents[1].glob(f"lib/{python.name}/os.py")).parent
    for file in (*root.rglob("*.py"), *root.glob("lib-dynload/*")):
        parts = list(file.relative_to(root).with_suffix("").parts)
        if file.name.endswith(NATIVE):
            parts = [file.name.partition(".")[0]]
        if parts[-1] == "__init__":
            parts.pop()
        if parts and all(map(_is_public, parts)) and PASSED_OVER.isdisjoint(parts):
            yield ".".join(parts)
    yield from ("builtins", "gc", "itertools", "sys", "time")


def _is_public(part: str) -> bool:
    return part.isidentifier() and not part.startswith("_")


def _differing(every: Sequence[Names], own: Names) -> Names:
    """Return the names of one version without those that all versions have, of owners that all versions have."""
    return {
        owner: tuple(sorted(set(names).difference(set(names).intersection(*(other[owner] for other in every)))))
        for owner, names in own.items()
        if all(owner in other for other in every)
    }

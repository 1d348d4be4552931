"""What follows from measured combinations and was not measured itself; told apart from them wherever it is shown.

Little follows. A version between two that work with all the rest alike, on the same Python and machine, is likely to
work, too, where nothing was seen of it; so is a Python between two. That two packages work apart says only that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.recommending import Known, Query, Wanted, fitting, good
from harness.reporttypes import number

PYTHON = "python"


class Inferred(msgspec.Struct, frozen=True, kw_only=True):
    """What was not measured: `versions` and `python` as asked, `why` a sentence, `from_cells` what it follows from.

    `kind` is `between` where two that work lie around it, `apart` where its packages only work each without another.
    """

    kind: str
    versions: dict[str, str]
    python: str
    why: str
    from_cells: tuple[str, ...]


def inferred(cells: Sequence[Known], query: Query) -> list[Inferred]:
    """What follows about a question that nothing measured answers."""
    return [*_versions_between(cells, query), *_pythons_between(cells, query)] or list(_apart(cells, query))


# --- between ---------------------------------------------------------------------------------------------------


def _versions_between(cells: Sequence[Known], query: Query) -> Iterator[Inferred]:
    """A pinned version of one package that no cell holds, beside all else that was asked for, between two that work."""
    seen = bool(fitting(cells, Query(wanted=query.wanted)))
    for place, wanted in enumerate(() if seen else query.wanted):
        pinned = _pin(wanted)
        free = replace(wanted, versions=SpecifierSet())
        other = replace(query, wanted=(*query.wanted[:place], free, *query.wanted[place + 1 :]))
        for before, after in _neighbours(cells, other, wanted.name) if pinned else ():
            low, high = (Version(str(one.version(wanted.name))) for one in (before, after))
            if pinned and low < pinned < high and _near(low, high):
                yield Inferred(
                    kind="between",
                    versions={name: str(before.version(name)) for name in query.names} | {wanted.name: str(pinned)},
                    python=before.python,
                    why=f"{wanted.name} {pinned} lies between {low} and {high}, both measured good with the same"
                    f" {_rest(before, wanted.name)}",
                    from_cells=(before.cell["id"], after.cell["id"]),
                )


def _near(low: Version, high: Version) -> bool:
    """Whether two releases make no great difference by their own account: of one major version, or of one 0.x."""
    return low.major == high.major and (low.major > 0 or low.minor == high.minor)


def _pythons_between(cells: Sequence[Known], query: Query) -> Iterator[Inferred]:
    """A Python on which nothing was measured, between two on which the same versions work."""
    if query.python is None or fitting(cells, replace(query, needs=(), env=None)):
        return
    asked = Version(query.python)
    for before, after in _neighbours(cells, replace(query, python=None), PYTHON):
        if Version(before.minor) < asked < Version(after.minor):
            yield Inferred(
                kind="between",
                versions={name: str(before.version(name)) for name in query.names},
                python=query.python,
                why=f"Python {query.python} lies between {before.minor} and {after.minor}, on both of which the same"
                f" versions were measured good: {_rest(before, PYTHON)}",
                from_cells=(before.cell["id"], after.cell["id"]),
            )


def _neighbours(cells: Sequence[Known], query: Query, axis: str) -> Iterator[tuple[Known, Known]]:
    """Cells that work and differ in one axis alone, without another one between them that does not."""

    def place(one: Known) -> Version:
        return Version(one.minor if axis == PYTHON else str(one.version(axis)))

    for alike in _alike(fitting(cells, replace(query, needs=(), env=None)), axis):
        for before, after in pairwise(sorted(alike, key=place)):
            if len(good((before, after), query)) == 2 and place(before) < place(after):
                yield before, after


def _pin(wanted: Wanted) -> Version | None:
    """The one version that was asked for, if it is one."""
    parts = list(wanted.versions)
    if len(parts) == 1 and parts[0].operator == "==" and not parts[0].version.endswith("*"):
        return Version(parts[0].version)
    return None


def _alike(cells: Iterable[Known], apart_from: str) -> list[list[Known]]:
    """Cells of one matrix and machine that differ in one axis and in nothing else that was chosen."""
    groups: dict[Any, list[Known]] = {}
    for one in cells:
        cell = one.cell
        if apart_from in cell["axes"]:
            axes = sorted((name, value) for name, value in cell["axes"].items() if name != apart_from)
            key = (cell["matrix"], cell["machine"], cell.get("base") and cell["id"], tuple(axes), _plain(cell))
            groups.setdefault(key, []).append(one)
    return list(groups.values())


def _plain(cell: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(sorted(cell["environment"].items())), tuple(one["package"] for one in cell["repairs"])


def _rest(one: Known, apart_from: str) -> str:
    """What was chosen besides, in words."""
    chosen = {"Python": one.minor} if apart_from != PYTHON else {}
    chosen |= {name: version for name, version in one.chosen.items() if name != apart_from}
    return ", ".join(f"{name} {version}" for name, version in chosen.items())


# --- apart -----------------------------------------------------------------------------------------------------


def _apart(cells: Sequence[Known], query: Query) -> Iterator[Inferred]:
    """Packages that work each without another, in locks that agree in all that both hold."""
    free = replace(query, wanted=tuple(replace(one, versions=SpecifierSet()) for one in query.wanted), python=None)
    if len(query.wanted) < 2 or fitting(cells, replace(free, needs=(), env=None)):
        return
    parts = [good(cells, replace(query, wanted=(one,))) for one in query.wanted]
    best: Inferred | None = None
    for first, second in combinations(parts, 2) if len(parts) == 2 else ():
        for one, other in ((one, other) for one in first for other in second):
            if _agree(one, other) and (best is None or _newer(one, other, query) > _order(best, query)):
                best = _of_parts(one, other, query)
    yield from [best] if best else []


def _agree(one: Known, other: Known) -> bool:
    shared = one.pins.keys() & other.pins.keys()
    same = (one.minor, one.cell["machine"]) == (other.minor, other.cell["machine"])
    return same and all(one.pins[name] == other.pins[name] for name in shared)


def _newer(one: Known, other: Known, query: Query) -> tuple[Version, ...]:
    first, second = query.names
    return Version(str(one.version(first))), Version(str(other.version(second))), Version(one.python)


def _order(found: Inferred, query: Query) -> tuple[Version, ...]:
    return (*(Version(found.versions[name]) for name in query.names), Version(found.python))


def _of_parts(one: Known, other: Known, query: Query) -> Inferred:
    first, second = query.names
    shared = len(one.pins.keys() & other.pins.keys())
    return Inferred(
        kind="apart",
        versions={first: str(one.version(first)), second: str(other.version(second))},
        python=one.python,
        why=f"{first} {one.version(first)} and {second} {other.version(second)} each work, and were never measured"
        f" together; their locks agree in all that both hold ({number(shared, 'package')})",
        from_cells=(one.cell["id"], other.cell["id"]),
    )

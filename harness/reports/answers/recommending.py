"""Find known-good combinations of packages in the document made by `digest`.

Measured and inferred results are kept apart. A `Combination` has cells that work. An `Inferred` has none, and names the
two cells between which it lies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.model import CASE_PHASES
from harness.model.vocabulary import settings
from harness.reports.answers import digest
from harness.reports.answers.measured_cells import PASSED, Known, Query, good

Plain = Mapping[str, Any]

NUMPY = "numpy"
"""The package of the arrays that all others pass around: its version is never left open."""


class Combination(msgspec.Struct, frozen=True, kw_only=True):
    """Versions that work together, as measured. The fields from `cell` on belong to one of the `cells`.

    `beside` are versions of other chosen packages with which all of it works, too. `settings` are variables that must
    be set for it, `repaired` are releases that no resolver accepts as the index has them.
    """

    versions: dict[str, str]
    pythons: tuple[str, ...]
    machines: tuple[str, ...]
    measured: str
    cells: tuple[str, ...]
    beside: dict[str, tuple[str, ...]]
    cell: str
    machine: str
    python: str
    phases: dict[str, str]
    unverified: tuple[str, ...]
    environments: tuple[str, ...]
    settings: dict[str, str]
    repaired: tuple[str, ...]
    brought: tuple[str, ...]
    lock_sha256: str
    lock: str
    requirements: tuple[str, ...]


# --- measured --------------------------------------------------------------------------------------------------


def combinations(document: Plain, cells: Iterable[Known], query: Query, limit: int | None = None) -> list[Combination]:
    """Return the combinations that work, newest first; at most `limit`.

    They are compared by the packages in the order in which these were asked for.
    """
    return combined(document, good(cells, query), query, limit)


def combined(document: Plain, found: Iterable[Known], query: Query, limit: int | None = None) -> list[Combination]:
    """Merge cells with equal versions of the packages asked for into combinations, newest first; at most `limit`."""
    return [combination(document, versions, alike) for versions, alike in grouped(found, query)[:limit]]


def grouped(found: Iterable[Known], query: Query) -> list[tuple[dict[str, str], list[Known]]]:
    """Group cells by their versions of the packages asked for, newest first."""
    groups: dict[tuple[str, ...], list[Known]] = {}
    for one in found:
        groups.setdefault(tuple(str(one.version(name)) for name in query.names), []).append(one)
    ordered = sorted(groups.items(), key=lambda group: newness(group[0]), reverse=True)
    return [(dict(zip(query.names, versions, strict=True)), cells) for versions, cells in ordered]


def newest(cells: Iterable[Known], query: Query) -> list[Known]:
    """Return the good cells of the newest combination."""
    groups = grouped(good(cells, query), query)
    return groups[0][1] if groups else []


def newness(versions: Iterable[str]) -> tuple[Version, ...]:
    """Return a sort key for versions: the newest combination has the greatest key."""
    return tuple(Version(version) for version in versions)


def combination(document: Plain, versions: dict[str, str], found: Sequence[Known]) -> Combination:
    """Merge cells with the same versions of the packages asked for into one combination."""
    best = max(found, key=_merit)
    cell = best.cell
    alike = [one for one in found if _plainness(one) == _plainness(best)]
    needed = tuple(settings(cell["supplied"], best.pins))
    return Combination(
        versions=versions,
        pythons=tuple(sorted({one.python for one in found}, key=Version, reverse=True)),
        machines=tuple(sorted({one.cell["machine"] for one in found})),
        measured=max(one.cell["measured"] for one in found),
        cells=tuple(one.cell["id"] for one in found),
        beside=beside(alike, best, versions),
        cell=cell["id"],
        machine=cell["machine"],
        python=best.python,
        phases=dict(cell["phases"]),
        unverified=tuple(cell["unverified"]),
        environments=tuple(dict.fromkeys(case["env"] for case in cell["cases"] if case["env"])),
        settings={**cell["environment"], **dict(text.split("=", 1) for text in needed)},
        repaired=tuple(f"{one['package']} {one['version']}" for one in cell["repairs"]),
        brought=tuple(cell.get("brought", ())),
        lock_sha256=cell["lock"],
        lock=digest.lock_text(document, cell["lock"]),
        requirements=tuple(pinned(best, versions)),
    )


def pinned(one: Known, asked: Iterable[str]) -> Iterator[str]:
    """Yield the requirements to install for a cell.

    These are the packages asked for, the others that the cell names, and the numpy that they share, all pinned.
    """
    extras: dict[str, set[str]] = {}
    for each in one.requirements:
        extras.setdefault(canonicalize_name(each.name), set()).update(each.extras)
    for name in dict.fromkeys((*asked, *extras, *one.chosen, *({NUMPY} & one.exercised))):
        version = one.version(name)
        if version:
            extra = f"[{','.join(sorted(extras[name]))}]" if extras.get(name) else ""
            yield f"{name}{extra}=={public(version)}"


def public(version: str) -> str:
    """Return a version without its local part, such as `+cpu`, which names an index and not a release."""
    return version.partition("+")[0]


def beside(found: Iterable[Known], one: Known, asked: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the versions in these cells of the other packages that the matrix of `one` chose."""
    names = [name for name in one.chosen if name not in {*asked}]
    held = {name: {other.chosen[name] for other in found if name in other.chosen} for name in names}
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


def _plainness(one: Known) -> tuple[bool, ...]:
    """Return whether a cell needs nothing unusual, one flag each: repairs, folders brought, variables, a change."""
    return not one.cell["repairs"], not one.cell.get("brought"), not one.variables, not one.cell.get("base")


def _merit(one: Known) -> tuple[Any, ...]:
    """Return a sort key for the cell that best represents equal ones.

    The greatest is plain, well verified, with few other packages, and on the newest Python.
    """
    verified = sum(one.cell["phases"].get(phase) == PASSED for phase in CASE_PHASES)
    return (
        _plainness(one),
        verified - len(one.cell["unverified"]),
        -len(one.chosen),
        Version(one.python),
        newness(one.chosen[name] for name in sorted(one.chosen)),
        one.cell["measured"],
    )


# --- nothing known ---------------------------------------------------------------------------------------------


def relaxed(query: Query) -> Iterator[tuple[str, Query]]:
    """Yield less strict questions, each with its description in words, the least change first."""
    if query.needs:
        yield f"where nothing is said of {' and '.join(query.needs)}", replace(query, needs=())
    if query.env:
        yield f"with other environments than {query.env}", replace(query, env=None)
    if query.python:
        yield f"on other Pythons than {query.python}", replace(query, python=None)
    free = tuple(replace(one, versions=SpecifierSet()) for one in query.wanted)
    if any(one.versions for one in query.wanted):
        yield "of other versions", replace(query, wanted=free)
    yield "of other versions, on other Pythons, whatever passed", Query(wanted=free)

"""Which versions work together: known-good combinations of packages, out of the document of `distilling`.

What was measured and what only follows from it are told apart: a `Combination` has cells that work, an `Inferred` has
none, and says between which it lies.
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
    """Versions that work together, as measured. `python`, `cell`, `lock` and what follows are those of one cell.

    `beside` are versions of other packages that were chosen, with which all of it works, too; `settings` are variables
    that have to be set for it, `repaired` releases that no resolver accepts as the index has them.
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
    """Return what works, the newest first, by what was asked for in the order in which it was; the first `limit`."""
    return combined(document, good(cells, query), query, limit)


def combined(document: Plain, found: Iterable[Known], query: Query, limit: int | None = None) -> list[Combination]:
    """Return cells as combinations, one for equal versions of what was asked for, the newest first."""
    return [combination(document, versions, alike) for versions, alike in grouped(found, query)[:limit]]


def grouped(found: Iterable[Known], query: Query) -> list[tuple[dict[str, str], list[Known]]]:
    """Return cells by their versions of what was asked for, the newest first."""
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
    """By which the newest of several combinations is the greatest."""
    return tuple(Version(version) for version in versions)


def combination(document: Plain, versions: dict[str, str], found: Sequence[Known]) -> Combination:
    """Return cells with the same versions of what was asked for as one combination."""
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
    """Yield what to install for a cell: what was asked for, the rest that it names, and the numpy that they share."""
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
    """Versions of what else the matrix of one cell chose, in all that were found."""
    names = [name for name in one.chosen if name not in {*asked}]
    held = {name: {other.chosen[name] for other in found if name in other.chosen} for name in names}
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


def _plainness(one: Known) -> tuple[bool, ...]:
    """Return whether nothing has to be done that nobody expects: repairs, folders brought, variables."""
    return not one.cell["repairs"], not one.cell.get("brought"), not one.variables, not one.cell.get("base")


def _merit(one: Known) -> tuple[Any, ...]:
    """Return how well a cell stands for equal ones: plain, verified, little else beside, the newest Python."""
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
    """The same question with less asked, and in words what it then is, the least change first."""
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

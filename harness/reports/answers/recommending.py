"""Find known-good combinations of packages in the document made by `digest`.

Measured and inferred results are kept apart. A `Combination` has cells that work. An `Inferred` has none, and names the
two cells between which it lies.

Cells of one lock, Python, machine and variables are one environment: what their cases ran was run together, whichever
matrices they are of.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.model import CASE_PHASES, Outcome, Phase, replace
from harness.model.vocabulary import settings
from harness.reports.answers.measured_cells import CellResult, Query, find_good, is_heavy

NUMPY = "numpy"
"""The package of the arrays that all others pass around: its version is never left open."""


class Combination(msgspec.Struct, frozen=True, kw_only=True):
    """Versions that work together, as measured. The fields from `cell` on belong to one of the `cells`.

    `beside` are versions of other chosen packages with which all of it works, too. `settings` are variables that must
    be set for it, `repaired` are releases that no resolver accepts as the index has them. `builds` are versions with a
    local part, such as `2.13.0+cpu`, which come from another index. `drawn` are the ways in which its pictures were
    drawn. `source` is the table that it comes from if neither lock nor evidence was kept: then `lock` is empty.
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
    phases: dict[Phase, Outcome]
    unverified: tuple[str, ...]
    environments: tuple[str, ...]
    settings: dict[str, str]
    repaired: tuple[str, ...]
    brought: tuple[str, ...]
    lock_sha256: str
    lock: str
    requirements: tuple[str, ...]
    builds: dict[str, str] = {}
    drawn: tuple[str, ...] = ()


# --- measured --------------------------------------------------------------------------------------------------


def combinations(cells: Iterable[CellResult], query: Query, limit: int | None = None) -> list[Combination]:
    """Return the combinations that work, newest first; at most `limit`.

    They are compared by the packages in the order in which these were asked for.
    """
    every = list(cells)
    groups = group_results(find_good([*every, *join_by_lock(every)], query), query)
    return [combination(versions, alike) for versions, alike in groups[:limit]]


def join_by_lock(cells: Iterable[CellResult]) -> list[CellResult]:
    """Return a result for each environment whose working cells ran more packages together than any of them alone."""
    environments: dict[Any, list[CellResult]] = {}
    for result in cells:
        if result.works:
            environments.setdefault(_environment(result), []).append(result)
    several = (alike for alike in environments.values() if len(alike) > 1)
    joined = (_join(alike) for alike in several if len({one.exercised for one in alike}) > 1)
    return [one for one in joined if all(one.exercised > part.exercised for part in one.parts)]


def _join(results: Sequence[CellResult]) -> CellResult:
    """Return the results of one environment as one, which has the cases and requirements of all of them."""
    best = max(results, key=_merit)
    cases = {(case.env, case.api, case.case): case for one in (*results, best) for case in one.cell.cases}
    # Where a cell noted nothing, the packages that it ran are known by its modules.
    ran = tuple(sorted({name for one in results for name in one.exercised}))
    noted = tuple(msgspec.structs.replace(case, exercised=ran) for case in cases.values())
    requirements = tuple(dict.fromkeys(text for one in results for text in one.cell.requirements))
    axes = {name: value for one in (*results, best) for name, value in one.cell.axes.items()}
    cell = msgspec.structs.replace(best.cell, cases=noted, requirements=requirements, axes=axes)
    return CellResult(cell=cell, measured=best.measured, newest=best.newest, parts=tuple(results))


def merge_results(results: Iterable[CellResult], query: Query, limit: int | None = None) -> list[Combination]:
    """Merge cells with equal versions of the packages asked for into combinations, newest first; at most `limit`."""
    return [combination(versions, alike) for versions, alike in group_results(results, query)[:limit]]


def group_results(results: Iterable[CellResult], query: Query) -> list[tuple[dict[str, str], list[CellResult]]]:
    """Group cells by their versions of the packages asked for, newest first."""
    groups: dict[tuple[str, ...], list[CellResult]] = {}
    for result in results:
        groups.setdefault(tuple(str(result.version(name)) for name in query.names), []).append(result)
    ordered = sorted(groups.items(), key=lambda group: newness(group[0]), reverse=True)
    return [(dict(zip(query.names, versions, strict=True)), cells) for versions, cells in ordered]


def newest(cells: Iterable[CellResult], query: Query) -> list[CellResult]:
    """Return the good cells of the newest combination."""
    groups = group_results(find_good(cells, query), query)
    return groups[0][1] if groups else []


def newness(versions: Iterable[str]) -> tuple[Version, ...]:
    """Return a sort key for versions: the newest combination has the greatest key."""
    return tuple(Version(version) for version in versions)


def combination(versions: dict[str, str], results: Sequence[CellResult]) -> Combination:
    """Merge cells with the same versions of the packages asked for into one combination."""
    best = max(results, key=_merit)
    cell = best.cell
    alike = [one for one in results if _plainness(one) == _plainness(best)]
    needed = settings(cell.supplied, best.versions)
    cases = [case for one in alike if _environment(one) == _environment(best) for case in one.cell.cases]
    return Combination(
        versions=versions,
        pythons=tuple(sorted({one.python for one in results}, key=Version, reverse=True)),
        machines=tuple(sorted({one.cell.machine for one in results})),
        measured=max(one.cell.measured for one in results),
        cells=tuple(dict.fromkeys(part.cell.id for one in results for part in one.parts or (one,))),
        beside=other_versions(alike, best, versions),
        cell=cell.id,
        machine=cell.machine,
        python=best.python,
        phases=dict(cell.phases),
        unverified=cell.unverified,
        environments=tuple(dict.fromkeys(case.env for case in cases if case.env)),
        settings={**cell.environment, **dict(text.split("=", 1) for text in needed)},
        repaired=tuple(f"{one.package} {one.version}" for one in cell.repairs),
        brought=tuple(one.name for one in cell.brought or ()),
        lock_sha256=cell.lock or "",
        lock=best.measured.lock_text(cell.lock) if cell.lock else "",
        requirements=tuple(pin_requirements(best, versions)),
        builds={name: version for name, version in best.pins.items() if "+" in version},
        drawn=tuple(sorted({case.drawn["api"] for case in cases if case.drawn.get("api")})),
    )


def pin_requirements(result: CellResult, packages: Iterable[str]) -> Iterator[str]:
    """Yield the requirements to install for a cell.

    These are the packages asked for, the others that the cell names, simulators and frameworks of its lock, packages
    that are held back, and the numpy that they share, all pinned.
    """
    extras: dict[str, set[str]] = {}
    for each in result.requirements:
        extras.setdefault(canonicalize_name(each.name), set()).update(each.extras)
    heavy = {name for name in result.pins if is_heavy(name)}
    others = {*heavy, *result.held_back, *({NUMPY} & result.exercised)}
    for name in dict.fromkeys((*packages, *extras, *result.chosen, *sorted(others))):
        version = result.version(name)
        if version:
            extra = f"[{','.join(sorted(extras[name]))}]" if extras.get(name) else ""
            yield f"{name}{extra}=={public_version(version)}"


def public_version(version: str) -> str:
    """Return a version without its local part, such as `+cpu`, which names an index and not a release."""
    return version.partition("+")[0]


def other_versions(
    results: Iterable[CellResult], result: CellResult, packages: Iterable[str]
) -> dict[str, tuple[str, ...]]:
    """Return the versions in these cells of the other packages that the matrix of `result` chose."""
    names = [name for name in result.chosen if name not in {*packages}]
    held = {name: {other.chosen[name] for other in results if name in other.chosen} for name in names}
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


def _environment(result: CellResult) -> tuple[Any, ...]:
    """Return what is equal for cells that were measured in one environment."""
    cell = result.cell
    return cell.lock or cell.id, result.python, cell.machine, tuple(sorted(cell.environment.items())), cell.empty or ()


def _plainness(result: CellResult) -> tuple[bool, ...]:
    """Return whether a cell needs nothing unusual, one flag each: repairs, folders brought, variables, a change."""
    return not result.cell.repairs, not result.cell.brought, not result.variables, not result.cell.base


def _merit(result: CellResult) -> tuple[Any, ...]:
    """Return a sort key for the cell that best represents equal ones.

    The greatest is plain, well verified, with few other packages, and on the newest Python.
    """
    verified = sum(result.cell.phases.get(phase) is Outcome.PASSED for phase in CASE_PHASES)
    return (
        _plainness(result),
        verified - len(result.cell.unverified),
        -len(result.chosen),
        Version(result.python),
        newness(result.chosen[name] for name in sorted(result.chosen)),
        result.cell.measured,
    )


# --- nothing known ---------------------------------------------------------------------------------------------


def relax(query: Query) -> Iterator[tuple[str, Query]]:
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
    yield "of other versions, on other Pythons, even if they passed", Query(wanted=free)

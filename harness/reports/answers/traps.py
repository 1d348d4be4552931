"""Find known traps: measured combinations that do not work, by cause, with the package that decides.

Versions that work elsewhere are no trap by themselves. Then the difference between the cells decides, and is named.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Set
from functools import partial
from typing import Any, NamedTuple

import msgspec
from packaging.version import Version

from harness.model import Verdict
from harness.model.vocabulary import CHANGING
from harness.reports.answers.measured_cells import (
    WAYS,
    CellResult,
    Query,
    case_works,
    find_fitting,
    find_good,
    names_env,
    some_work,
    works,
)
from harness.reports.answers.recommending import newness


class Red(msgspec.Struct, frozen=True, kw_only=True):
    """Combinations that do not work, for one cause: `causes` are signatures, `line` is the decisive line of one cell.

    `deciding` are the versions of packages, of Python or of variables that differ from working cells with the same
    versions of the packages asked for. It is empty if no such combination: then other packages that the cells asked
    for may be at fault. `beside` are their versions. `instead` are the versions of the working cell that is nearest.
    `tasks` are the environments that fail; `elsewhere` is whether others work with these very versions. `remedy` says
    in a few words what to do about the first of the causes.
    """

    versions: tuple[dict[str, str], ...]
    deciding: dict[str, tuple[str, ...]]
    beside: dict[str, tuple[str, ...]]
    pythons: tuple[str, ...]
    verdicts: tuple[str, ...]
    phase: str | None
    causes: tuple[str, ...]
    line: str | None
    reason: str | None
    link: str | None
    cells: tuple[str, ...]
    measured: str = ""
    tasks: tuple[str, ...] = ()
    elsewhere: bool = False
    instead: dict[str, str] = {}
    remedy: str | None = None


NO_RELEASE = re.compile(r"no version of|was not found in")
"""A typo is no measurement of packages."""


def find_traps(cells: Sequence[CellResult], query: Query) -> list[Red]:
    """Return the traps for a question by cause, those with the newest release first.

    Versions that work in another cell are listed apart from those that never work together. Left out are failures with
    a lock that works elsewhere (then versions are not the cause), and cells with nothing but environments of the
    matrix's own.
    """
    matches = find_fitting(cells, query)
    fine = {one.cell.lock for one in cells if one.works}
    reds = [one for one in matches if one.cell.verdict is not Verdict.WORKS and not works(one, query) and not one.own]
    reds = [one for one in reds if one.cell.lock is None or one.cell.lock not in fine]
    reds = [one for one in reds if not NO_RELEASE.search(one.cell.decisive or "")]
    anywhere = Query(wanted=query.wanted, env=query.env)
    twins = find_good(cells, anywhere) or [one for one in matches if some_work(one)]
    together: dict[tuple[str, ...], list[CellResult]] = {}
    for twin in twins:
        together.setdefault(_query_versions(twin, query), []).append(twin)
    halves = [
        part
        for found in _by_cause(reds)
        for part in (
            [one for one in found if _query_versions(one, query) in together],
            [one for one in found if _query_versions(one, query) not in together],
        )
        if part
    ]
    best = max(twins, key=lambda twin: newness(_query_versions(twin, query)), default=None)
    weight = partial(_weight, present={*query.names, *best.versions} if best else None)
    return sorted((_red(found, query, together) for found in halves), key=weight, reverse=True)


def _weight(trap: Red, present: Set[str] | None) -> tuple[Any, ...]:
    """Return a sort key for traps: the greatest has the newest release, then no other package that decides.

    First come those in which nothing was asked for but what is `present` in the newest combination that works. A
    failure of some tasks alone weighs less than one of all.
    """
    others = {*trap.deciding, *([] if trap.deciding else trap.beside)} - {"Python"}
    first, *rest = newness(trap.versions[0].values())
    return (
        present is None or {*trap.beside} <= present,
        first,
        not (trap.elsewhere and not trap.deciding),
        not others,
        not trap.deciding,
        tuple(rest),
    )


def _by_cause(reds: Sequence[CellResult]) -> list[list[CellResult]]:
    """Group red cells by known issue, else by the reason that a matrix gives for their line, else by the line."""
    reasons: dict[Any, set[str]] = {}
    for cell_result in reds:
        reasons.setdefault(_line(cell_result), set()).update(filter(None, [cell_result.reason]))
    groups: dict[tuple[Any, ...], list[CellResult]] = {}
    for cell_result in reds:
        elsewhere = reasons[_line(cell_result)] if len(reasons[_line(cell_result)]) == 1 else ()
        cause = cell_result.cell.causes or cell_result.reason or next(iter(elsewhere), None) or _line(cell_result)
        groups.setdefault((cell_result.cell.phase, cause), []).append(cell_result)
    return list(groups.values())


def _line(result: CellResult) -> tuple[str | None, str]:
    """Return the phase and the decisive line, its line numbers and versions masked."""
    return result.cell.phase, CHANGING.sub("…", result.cell.decisive or "")


def _query_versions(result: CellResult, query: Query) -> tuple[str, ...]:
    return tuple([str(result.version(one.name)) for one in query.wanted])


def _red(group: Sequence[CellResult], query: Query, twins: Mapping[tuple[str, ...], Sequence[CellResult]]) -> Red:
    results = sorted(group, key=lambda one: newness(_query_versions(one, query)), reverse=True)
    cell = results[0].cell
    explained = next((one for one in group if one.reason), results[0])
    held = {_query_versions(one, query) for one in results}
    nearest = _nearest(results, query, twins)
    failing = {name: None for one in results for name in _failing(one, query)}
    return Red(
        versions=tuple(dict(zip(query.names, one, strict=True)) for one in sorted(held, key=newness, reverse=True)),
        deciding=_deciding(nearest),
        beside=_others(results, query.names),
        pythons=tuple(sorted({one.minor for one in results}, key=Version, reverse=True)),
        verdicts=tuple(sorted({one.cell.verdict for one in results})),
        phase=cell.phase,
        causes=cell.causes,
        line=cell.decisive,
        reason=explained.reason,
        link=explained.cell.expectation.link if explained.cell.expectation else None,
        cells=tuple(one.cell.id for one in results),
        measured=max(one.cell.measured for one in results),
        tasks=tuple(failing),
        elsewhere=bool(nearest),
        instead=_instead(nearest),
        remedy=next(filter(None, (results[0].measured.remedies.get(name) for name in cell.causes)), None),
    )


def _failing(result: CellResult, query: Query) -> list[str]:
    """Return the environments of a cell that fail, or the one that was asked for."""
    cases = [case for case in result.cell.cases if case.env and not case_works(case)]
    return [case.env for case in cases if case.env and (query.env is None or names_env(case, query.env))]


def _others(results: Iterable[CellResult], packages: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the versions of the other packages that red cells name, newest first."""
    held: dict[str, set[str]] = {}
    for result in results:
        for name, version in result.chosen.items():
            if name not in packages:
                held.setdefault(name, set()).add(version)
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


# --- what decides ----------------------------------------------------------------------------------------------


class Difference(NamedTuple):
    """A red cell, the working cell nearest to it, and the values in which the red one differs."""

    red: CellResult
    twin: CellResult
    values: dict[str, str]


def _nearest(
    results: Iterable[CellResult], query: Query, twins: Mapping[tuple[str, ...], Sequence[CellResult]]
) -> list[Difference]:
    """Return the differences of red cells from their nearest green twins; those without a twin are left out."""
    differences = []
    for result in results:
        alike = twins.get(_query_versions(result, query), ())
        candidates = (Difference(result, twin, _difference(result, twin, query.names)) for twin in alike)
        nearest = min(candidates, key=lambda each: len(each.values), default=None)
        differences += [nearest] if nearest else []
    return differences


def _deciding(nearest: Iterable[Difference]) -> dict[str, tuple[str, ...]]:
    """Return the values that red cells have and their nearest green twins have not."""
    held: dict[str, set[str]] = {}
    for difference in nearest:
        for name, value in difference.values.items():
            held.setdefault(name, set()).add(value)
    return {name: tuple(sorted(values, reverse=True)) for name, values in sorted(held.items())}


def _instead(nearest: Iterable[Difference]) -> dict[str, str]:
    """Return what the nearest green twin of the first red cell has in place of what decides."""
    for _, twin, values in nearest:
        facts = {"Python": twin.minor, **twin.cell.environment, **twin.versions}
        return {name: facts.get(name, "absent") for name in values}
    return {}


def _difference(result: CellResult, twin: CellResult, packages: Iterable[str]) -> dict[str, str]:
    """Return how a red cell differs from a green one: packages it names, variables, Python."""
    mine = {name: version for name, version in result.chosen.items() if name not in packages}
    differs = {name: version for name, version in mine.items() if twin.version(name) != version}
    # Without a lock it is not known what was absent.
    gone = {name: "absent" for name in twin.chosen if name not in packages and name not in result.pins and result.pins}
    theirs = twin.cell.environment
    variables = {name: value for name, value in result.variables.items() if theirs.get(name) != value}
    # How to draw is set in most cells, and decides only where another way works.
    ways = {WAYS: result.cell.environment.get(WAYS, ""), **variables}
    variables = ways if ways[WAYS] and theirs.get(WAYS, ways[WAYS]) != ways[WAYS] else variables
    python = {"Python": result.minor} if result.minor != twin.minor else {}
    return {**gone, **differs, **variables, **python}

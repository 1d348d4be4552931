"""Build the answer of `recommend`: combinations that work, work in part, or were never measured together."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from packaging.specifiers import SpecifierSet

from harness.model import Verdict
from harness.reports.answers import inferring, recommending, traps, weighing
from harness.reports.answers.inferring import Inferred
from harness.reports.answers.measured_cells import (
    CellResult,
    Query,
    Wanted,
    case_works,
    find_fitting,
    passes,
    ran,
    some_work,
)
from harness.reports.answers.never_together import Apart, find_apart, installed_releases
from harness.reports.answers.recommending import Combination
from harness.reports.answers.traps import Red
from harness.reports.answers.weighing import Weighed


class Nearby(msgspec.Struct, frozen=True, kw_only=True):
    """Measured combinations near the one asked for; `where` says how they differ from it."""

    where: str
    combinations: tuple[Combination, ...]


class Partly(msgspec.Struct, frozen=True, kw_only=True):
    """A combination in which only some environments work: their names, and why the others fail."""

    combination: Combination
    verdict: str
    works: tuple[str, ...]
    fails: dict[str, str]


class Recommended(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `recommend --json`: measured combinations, inferred ones, and those that do not work.

    `found` is the number of combinations that work, `measured` has the newest of them. Those in `doubtful` work, too,
    but a silent known issue fits them that no check has shown or refuted. `weighed` says why the first one is first. In
    `partly` only some environments work. `newer` work on other Pythons; `newer_unfit` says which release is not for the
    Python asked for. `apart` is set if the packages were never measured together. `unknown` are packages without any
    measurement, `installed` releases that were only in locks and never run. `next` is a command that would measure what
    was asked for.
    """

    schema: int = 1
    asked: tuple[str, ...]
    python: str | None
    needs: tuple[str, ...]
    env: str | None
    found: int
    weighed: Weighed | None = None
    measured: tuple[Combination, ...]
    doubtful: tuple[Combination, ...]
    partly: tuple[Partly, ...]
    newer: tuple[Combination, ...]
    newer_unfit: str = ""
    apart: Apart | None
    inferred: tuple[Inferred, ...]
    red: tuple[Red, ...]
    nearby: Nearby | None
    unknown: tuple[str, ...]
    installed: dict[str, tuple[str, ...]]
    next: str


def build_answer(cells: Sequence[CellResult], query: Query, limit: int, next_: str) -> Recommended:
    """Return everything that the measured cells say about a question; `limit` bounds the lists of combinations."""
    every = cells
    # Whatever is found has all the packages, and most cells have not.
    cells = [one for one in every if all(one.version(name) for name in query.names)]
    combinations = recommending.combinations(cells, query)
    # The sort is stable: among equals the newest stays first.
    # What anybody can install goes first.
    combinations.sort(key=lambda one: bool(one.repaired or one.brought))
    together = None if combinations else find_apart(every, query)
    newer = _newer(cells, query, combinations)
    never_run = [name for name in query.names if not any(name in one.about for one in every if one.version(name))]
    return Recommended(
        asked=tuple(one.text for one in query.wanted),
        python=query.python,
        needs=tuple(query.needs),
        env=query.env,
        found=len(combinations),
        weighed=weighing.weigh(every, combinations, query),
        measured=tuple(combinations[:limit]),
        doubtful=tuple(_doubtful(cells, query, combinations)[:limit]),
        partly=() if combinations else tuple(_partly(cells, query)[:limit]),
        newer=tuple(newer),
        newer_unfit=next(filter(None, (_unfit(one, query.python or "") for one in newer)), ""),
        apart=together,
        inferred=() if combinations else tuple(inferring.infer(cells, query)[:limit]),
        red=tuple(traps.find_traps(cells, query)),
        nearby=None if combinations or together else _nearby(cells, query, limit),
        unknown=tuple(name for name in query.names if not any(one.version(name) for one in every)),
        installed={name: releases for name in never_run if (releases := installed_releases(every, name))},
        next=next_,
    )


def infer_release(cells: Sequence[CellResult], wanted: Wanted) -> list[Inferred]:
    """Return the combinations that are inferred for one release of a package."""
    return inferring.infer(cells, Query(wanted=(wanted,)))


def _doubtful(cells: Sequence[CellResult], query: Query, combinations: Sequence[Combination]) -> list[Combination]:
    """Return combinations that work with a silent known issue left open, unless a plainly good one is newer."""
    fits = [one for one in find_fitting(cells, query) if ran(one, query) and one.cell.verdict is Verdict.WORKS]
    open_ = [one for one in fits if passes(one, query) and one.cell.doubts]
    candidates = recommending.merge_results(open_, query)
    best = max((recommending.newness(one.versions.values()) for one in combinations), default=())
    return [one for one in candidates if recommending.newness(one.versions.values()) >= best]


def _partly(cells: Sequence[CellResult], query: Query) -> list[Partly]:
    """Return combinations that work in part, newest first, each by the cell with the most working environments."""
    fits = [
        one
        for one in find_fitting(cells, query)
        if ran(one, query) and one.cell.verdict in {Verdict.PARTIAL, Verdict.MISLEADS}
    ]
    fits = [one for one in fits if some_work(one)]
    entries = []
    for versions, results in recommending.group_results(fits, query):
        best = max(results, key=lambda result: sum(map(case_works, result.cell.cases)))
        entries.append(
            Partly(
                combination=recommending.combination(versions, [best]),
                verdict=best.cell.verdict,
                works=tuple(case.case for case in best.cell.cases if case_works(case)),
                fails={
                    case.case: case.decisive or ", ".join(case.misleads) or "not verified"
                    for case in best.cell.cases
                    if not case_works(case)
                },
            )
        )
    return entries


def _newer(cells: Sequence[CellResult], query: Query, combinations: Sequence[Combination]) -> list[Combination]:
    """Return the newest combination on other Pythons, if it is newer and was not measured on the Python asked for."""
    if query.python is None or not combinations:
        return []
    anywhere = Query(wanted=query.wanted, needs=query.needs, env=query.env)
    (best,), seen = recommending.combinations(cells, anywhere, limit=1), find_fitting(cells, query)
    newest = recommending.newness(best.versions.values())
    if newest <= recommending.newness(combinations[0].versions.values()):
        return []
    measured = any(tuple(one.version(name) for name in query.names) == tuple(best.versions.values()) for one in seen)
    return [] if measured else [best]


def _unfit(combination: Combination, python: str) -> str:
    """Return which release of a combination declares that it is not for a Python; empty if none does."""
    from harness.standalone.explain.api_history import load_shipped  # noqa: PLC0415 - start-up

    for name, version in combination.versions.items():
        history = load_shipped(name)
        releases = history.plain["releases"] if history else ()
        wanted = next((each.get("python") for each in releases if each["version"] == version), None)
        if wanted and not SpecifierSet(wanted).contains(f"{python}.99" if python.count(".") == 1 else python):
            return f"{name} {version} requires Python {wanted}"
    return ""


def _nearby(cells: Sequence[CellResult], query: Query, limit: int) -> Nearby | None:
    """Return good combinations for the first relaxed question that has any, or None."""
    for where, other in recommending.relax(query):
        combinations = recommending.combinations(cells, other, limit=limit)
        if combinations:
            return Nearby(where=where, combinations=tuple(combinations))
    return None

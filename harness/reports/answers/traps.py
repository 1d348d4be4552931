"""Find known traps: measured combinations that do not work, by cause, with the package that decides.

Versions that work elsewhere are no trap by themselves. Then the difference between the cells decides, and is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from packaging.version import Version

from harness.model import Verdict
from harness.model.vocabulary import CHANGING
from harness.reports.answers.measured_cells import CellResult, Query, find_fitting, find_good, some_work, works
from harness.reports.answers.recommending import newness


class Red(msgspec.Struct, frozen=True, kw_only=True):
    """Combinations that do not work, for one cause: `causes` are signatures, `line` is the decisive line of one cell.

    `deciding` are the versions of packages, of Python or of variables that differ from working cells with the same
    versions of the packages asked for. It is empty if there is no such cell: then other packages that the cells asked
    for may be at fault. `beside` are their versions.
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
    twins = find_good(cells, Query(wanted=query.wanted, env=query.env)) or [one for one in matches if some_work(one)]
    together = {_query_versions(one, query) for one in twins}
    halves = [
        part
        for found in _by_cause(reds)
        for part in (
            [one for one in found if _query_versions(one, query) in together],
            [one for one in found if _query_versions(one, query) not in together],
        )
        if part
    ]
    return sorted((_red(found, query, twins) for found in halves), key=_weight, reverse=True)


def _weight(trap: Red) -> tuple[Any, ...]:
    """Return a sort key for traps: the greatest has the newest release, then no other package that decides."""
    others = {*trap.deciding, *([] if trap.deciding else trap.beside)} - {"Python"}
    first, *rest = newness(trap.versions[0].values())
    return first, not others, not trap.deciding, tuple(rest)


def _by_cause(reds: Sequence[CellResult]) -> list[list[CellResult]]:
    """Group red cells by known issue, else by the reason that a matrix gives for their line, else by the line."""
    reasons: dict[Any, set[str]] = {}
    for cell_result in reds:
        reasons.setdefault(_line(cell_result), set()).update(filter(None, [cell_result.reason]))
    groups: dict[tuple[Any, ...], list[CellResult]] = {}
    # Cells with a reason come first, because `_red` takes reason and link from the first cell of a group.
    for cell_result in sorted(reds, key=lambda result: not result.reason):
        elsewhere = reasons[_line(cell_result)] if len(reasons[_line(cell_result)]) == 1 else ()
        cause = cell_result.cell.causes or cell_result.reason or next(iter(elsewhere), None) or _line(cell_result)
        groups.setdefault((cell_result.cell.phase, cause), []).append(cell_result)
    return list(groups.values())


def _line(result: CellResult) -> tuple[str | None, str]:
    """Return the phase and the decisive line, its line numbers and versions masked."""
    return result.cell.phase, CHANGING.sub("…", result.cell.decisive or "")


def _query_versions(result: CellResult, query: Query) -> tuple[str, ...]:
    return tuple(str(result.version(name)) for name in query.names)


def _red(results: Sequence[CellResult], query: Query, twins: Sequence[CellResult]) -> Red:
    cell = results[0].cell
    held = {_query_versions(one, query) for one in results}
    return Red(
        versions=tuple(dict(zip(query.names, one, strict=True)) for one in sorted(held, key=newness, reverse=True)),
        deciding=_deciding(results, query, twins),
        beside=_others(results, query.names),
        pythons=tuple(sorted({one.minor for one in results}, key=Version, reverse=True)),
        verdicts=tuple(sorted({one.cell.verdict for one in results})),
        phase=cell.phase,
        causes=cell.causes,
        line=cell.decisive,
        reason=results[0].reason,
        link=cell.expectation.link if cell.expectation else None,
        cells=tuple(one.cell.id for one in results),
    )


def _others(results: Iterable[CellResult], packages: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the versions of the other packages that red cells name, newest first."""
    held: dict[str, set[str]] = {}
    for result in results:
        for name, version in result.chosen.items():
            if name not in packages:
                held.setdefault(name, set()).add(version)
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


# --- what decides ----------------------------------------------------------------------------------------------


def _deciding(results: Sequence[CellResult], query: Query, twins: Sequence[CellResult]) -> dict[str, tuple[str, ...]]:
    """Return the values that red cells have and their nearest green twins have not; empty if they have no twins."""
    held: dict[str, set[str]] = {}
    for result in results:
        alike = [twin for twin in twins if _query_versions(twin, query) == _query_versions(result, query)]
        for name, value in min((_difference(result, twin, query.names) for twin in alike), key=len, default={}).items():
            held.setdefault(name, set()).add(value)
    return {name: tuple(sorted(values, reverse=True)) for name, values in sorted(held.items())}


def _difference(result: CellResult, twin: CellResult, packages: Iterable[str]) -> dict[str, str]:
    """Return how a red cell differs from a green one: packages it names, variables, Python."""
    mine = {name: version for name, version in result.chosen.items() if name not in packages}
    differs = {name: version for name, version in mine.items() if twin.version(name) != version}
    # Without a lock it is not known what was absent.
    gone = {name: "absent" for name in twin.chosen if name not in packages and name not in result.pins and result.pins}
    variables = {name: value for name, value in result.variables.items() if twin.variables.get(name) != value}
    python = {"Python": result.minor} if result.minor != twin.minor else {}
    return {**gone, **differs, **variables, **python}

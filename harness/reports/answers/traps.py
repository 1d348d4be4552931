"""Find known traps: measured combinations that do not work, by cause, with the package that decides.

Versions that work elsewhere are no trap by themselves. Then the difference between the cells decides, and is named.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
from packaging.version import Version

from harness.model.vocabulary import CHANGING
from harness.reports.answers.measured_cells import Known, Query, fitting, good, some_work, works
from harness.reports.answers.recommending import newness

WORKS = "works"


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


def red(cells: Sequence[Known], query: Query) -> list[Red]:
    """Return the traps for a question by cause, those with the newest release first.

    Versions that work in another cell are listed apart from those that never work together. Left out are failures with
    a lock that works elsewhere (then versions are not the cause), and cells with nothing but environments of the
    matrix's own.
    """
    asked = fitting(cells, query)
    fine = {one.cell["lock"] for one in cells if one.works}
    reds = [one for one in asked if one.cell["verdict"] != WORKS and not works(one, query) and not one.cell.get("own")]
    reds = [one for one in reds if one.cell["lock"] is None or one.cell["lock"] not in fine]
    twins = good(cells, Query(wanted=query.wanted, env=query.env)) or [one for one in asked if some_work(one)]
    together = {_asked(one, query) for one in twins}
    halves = [
        part
        for found in _by_cause(reds)
        for part in (
            [one for one in found if _asked(one, query) in together],
            [one for one in found if _asked(one, query) not in together],
        )
        if part
    ]
    return sorted((_red(found, query, twins) for found in halves), key=_weight, reverse=True)


def _weight(one: Red) -> tuple[Any, ...]:
    """Return a sort key for traps: the greatest has the newest release, then no other package that decides."""
    others = {*one.deciding, *([] if one.deciding else one.beside)} - {"Python"}
    first, *rest = newness(one.versions[0].values())
    return first, not others, not one.deciding, tuple(rest)


def _by_cause(reds: Sequence[Known]) -> list[list[Known]]:
    """Group red cells by known issue, else by the reason that a matrix gives for their line, else by the line."""
    said: dict[Any, set[str]] = {}
    for one in reds:
        said.setdefault(_line(one), set()).update(filter(None, [one.cell.get("reason")]))
    groups: dict[tuple[Any, ...], list[Known]] = {}
    for one in sorted(reds, key=lambda one: not one.cell.get("reason")):
        elsewhere = said[_line(one)] if len(said[_line(one)]) == 1 else ()
        cause = tuple(one.cell["causes"]) or one.cell.get("reason") or next(iter(elsewhere), None) or _line(one)
        groups.setdefault((one.cell["phase"], cause), []).append(one)
    return list(groups.values())


def _line(one: Known) -> tuple[str | None, str]:
    """Return the phase and the decisive line, its line numbers and versions masked."""
    return one.cell["phase"], CHANGING.sub("…", one.cell["decisive"] or "")


def _asked(one: Known, query: Query) -> tuple[str, ...]:
    return tuple(str(one.version(name)) for name in query.names)


def _red(found: Sequence[Known], query: Query, twins: Sequence[Known]) -> Red:
    cell = found[0].cell
    held = {_asked(one, query) for one in found}
    return Red(
        versions=tuple(dict(zip(query.names, one, strict=True)) for one in sorted(held, key=newness, reverse=True)),
        deciding=_deciding(found, query, twins),
        beside=_others(found, query.names),
        pythons=tuple(sorted({one.minor for one in found}, key=Version, reverse=True)),
        verdicts=tuple(sorted({one.cell["verdict"] for one in found})),
        phase=cell["phase"],
        causes=tuple(cell["causes"]),
        line=cell["decisive"],
        reason=cell.get("reason"),
        link=cell.get("link"),
        cells=tuple(one.cell["id"] for one in found),
    )


def _others(found: Iterable[Known], asked: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the versions of the other packages that red cells name, newest first."""
    held: dict[str, set[str]] = {}
    for one in found:
        for name, version in one.chosen.items():
            if name not in asked:
                held.setdefault(name, set()).add(version)
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


# --- what decides ----------------------------------------------------------------------------------------------


def _deciding(found: Sequence[Known], query: Query, twins: Sequence[Known]) -> dict[str, tuple[str, ...]]:
    """Return the values that red cells have and their nearest green twins have not; empty if they have no twins."""
    held: dict[str, set[str]] = {}
    for one in found:
        alike = [twin for twin in twins if _asked(twin, query) == _asked(one, query)]
        for name, value in min((_difference(one, twin, query.names) for twin in alike), key=len, default={}).items():
            held.setdefault(name, set()).add(value)
    return {name: tuple(sorted(values, reverse=True)) for name, values in sorted(held.items())}


def _difference(one: Known, twin: Known, asked: Iterable[str]) -> dict[str, str]:
    """Return how a red cell differs from a green one: packages it names, variables, Python."""
    mine = {name: version for name, version in one.chosen.items() if name not in asked}
    differs = {name: version for name, version in mine.items() if twin.version(name) != version}
    gone = {name: "absent" for name in twin.chosen if name not in asked and name not in one.pins and one.pins}
    variables = {name: value for name, value in one.variables.items() if twin.variables.get(name) != value}
    python = {"Python": one.minor} if one.minor != twin.minor else {}
    return {**gone, **differs, **variables, **python}

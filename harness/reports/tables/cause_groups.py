"""Group cells that are not green by cause: one broken release reads as one line, with its cells in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from packaging.version import InvalidVersion, Version

from harness.judging.known_failures import select_counting
from harness.model.report_types import REPAIR, SEVERITY, CellEntry, format_count
from harness.model.vocabulary import CHANGING
from harness.reports.tables import change_effects, fix_commands, verdict_reasons, working_neighbours
from harness.reports.tables.table_types import Cause, Explanation, Trouble

NAMED = 2
"""Cells that are named; more are told by the values of their axes."""

RANGE = 3
"""Values one after the other, of which the first and the last are told."""

REASON, LINE = "said", "line"

Reason = tuple[Explanation, list[CellEntry]]
Held = Mapping[str, set[str | None]]


def troubles(cells: Sequence[CellEntry], axes: Sequence[str]) -> tuple[Trouble, ...]:
    """Return one entry per cause, those of most cells first.

    A cause is a known failure, else the reason that the matrix gives, else the decisive line.
    """
    groups: dict[tuple[str, ...], list[Reason]] = {}
    for why, results in verdict_reasons.reasons(cells):
        groups.setdefault(_cause(why, results[0]), []).append((why, results))
    for key in [key for key in groups if key[0] == LINE]:
        matches = [
            other for other, held in groups.items() if other[0] == REASON and any(_line(why) == key for why, _ in held)
        ]
        if len(matches) == 1:  # the matrix speaks of this line elsewhere, and of one cause
            groups[matches[0]] += groups.pop(key)
    return tuple(sorted((_trouble(held, cells, axes) for held in groups.values()), key=lambda trouble: -trouble.cells))


def _cause(why: Explanation, cell: CellEntry) -> tuple[str, ...]:
    """Return a key that is equal for two reasons of one cause."""
    if why.causes:
        return "known", why.causes[0].signature
    if cell.expectation and cell.as_expected:
        return REASON, cell.expectation.reason
    return _line(why) if why.decisive else ("verdict", why.verdict, why.phase)


def _line(why: Explanation) -> tuple[str, ...]:
    return LINE, why.phase, CHANGING.sub("…", why.decisive)


def _trouble(reasons: Sequence[Reason], cells: Sequence[CellEntry], axes: Sequence[str]) -> Trouble:
    explanations = tuple(why for why, _ in reasons)
    group = [cell for _, results in reasons for cell in results]
    failure = next((why.causes[0] for why in explanations if why.causes), None)
    expected = next((cell.expectation for cell in group if cell.as_expected and cell.expectation), None)
    verdicts = Counter(cell.verdict for cell in group)
    links = (why.link for why in explanations if why.link)
    proofs = tuple(dict.fromkeys(proof for why in explanations for one in why.causes[:1] for proof in one.proofs))
    proven = {cell.id for cell in group if (held := select_counting(cell)) and held[0].proof}
    cures = _cures(group, cells)
    found_out = bool(cures) and not proven
    alone, together = ("", "") if proofs or cures else working_neighbours.find(group, cells)
    return Trouble(
        known=failure.signature if failure else "",
        cause=failure.cause if failure else expected.reason if expected else "",
        verdicts=tuple((verdict, verdicts[verdict]) for verdict in SEVERITY if verdicts[verdict]),
        phases=tuple(dict.fromkeys(why.phase for why in explanations if why.phase)),
        cells=len({cell.id for cell in group}),
        where=_named([label for why in explanations for label in why.cells]) or place_cells(group, cells, axes),
        line=explanations[0].decisive,
        remedy="; ".join(cures[0].change.does) if found_out and cures[0].change else failure.remedy if failure else "",
        applicable=found_out or (failure.applicable if failure else False),
        proofs=tuple((cell.label, cell.lock or "") for cell in cures) if found_out else proofs,
        references=tuple(dict.fromkeys((*(failure.references if failure else ()), *links))),
        explanations=explanations,
        proven=len({cell.base for cell in cures} if found_out else proven),
        neighbour=alone,
        together=together,
        also=tuple(_also(explanations)),
        commands=_commands(cures[0] if found_out else None, group, failure),
        example=group[0].id,
    )


def _commands(cure: CellEntry | None, group: Iterable[CellEntry], failure: Cause | None) -> tuple[str, ...]:
    """Return the commands of the fix that `run --repair` found, else of the known issue's."""
    if cure and cure.change:
        return fix_commands.commands(cure.change.change)
    counting = (select_counting(cell) for cell in group)
    fix = next((one[0].remedy for one in counting if failure and one and one[0].signature == failure.signature), {})
    return fix_commands.commands(fix)


def _cures(group: Iterable[CellEntry], cells: Iterable[CellEntry]) -> list[CellEntry]:
    """Return the cells that `run --repair` made of these and that work: each proves the remedy that it found."""
    places = {(cell.id, cell.machine) for cell in group}
    return [
        cell
        for cell in cells
        if cell.change and cell.change.name == REPAIR and change_effects.works(cell)
        if (cell.base, cell.machine) in places
    ]


def _also(explanations: Iterable[Explanation]) -> Iterable[Cause]:
    """Return the known failures that fit some of the cells after the deepest cause, once each."""
    causes: dict[str, Cause] = {}
    for cause in (one for why in explanations for one in why.causes[1:]):
        before = causes.get(cause.signature)
        causes[cause.signature] = cause if before is None or (cause.proofs and not before.proofs) else before
    return causes.values()


# --- which cells -----------------------------------------------------------------------------------------------


def _named(labels: Sequence[str]) -> str:
    """Return the names of a few cells, with the machine where not all agree; empty for more than `NAMED` cells."""
    return ", ".join("`" + label.replace(" on ", "` on `") + "`" for label in labels) if len(labels) <= NAMED else ""


def name_cells(group: Sequence[CellEntry], cells: Sequence[CellEntry], axes: Sequence[str]) -> str:
    """Describe these cells: a few by their names, more by the values of their axes."""
    return _named([*dict.fromkeys(cell.label for cell in group)]) or place_cells(group, cells, axes)


def place_cells(group: Sequence[CellEntry], cells: Sequence[CellEntry], axes: Sequence[str]) -> str:
    """Describe these cells of a matrix: `all 12 combinations with mujoco 4.0.0`; of changed cells the first names."""
    labels = tuple(dict.fromkeys(cell.label for cell in group))
    if any(cell.base for cell in group):
        return f"{_named(labels[:NAMED])} and {format_count(len(labels) - NAMED, 'more combination')}"
    planned, held, needed_axes = _needed(group, cells, axes)
    words = telling_values(group, cells, axes)
    inside = len(_inside(needed_axes, held, planned))
    whole = "the only combination" if inside == 1 else f"all {format_count(inside, 'combination')}"
    count = whole if inside == len(labels) else f"{len(labels)} of {format_count(inside, 'combination')}"
    return count + (f" with {', '.join(words)}" if words else "")


def telling_values(group: Sequence[CellEntry], cells: Sequence[CellEntry], axes: Sequence[str]) -> list[str]:
    """Return the axis values by which these cells are told from all others: `["mujoco 3.0.1 to 4.0.0"]`."""
    planned, held, needed_axes = _needed(group, cells, axes)
    every = {axis: in_order(value for one in planned if (value := one.get(axis))) for axis in needed_axes}
    return [
        f"{axis} {_values([value for value in every[axis] if value in held[axis]], every[axis])}"
        for axis in needed_axes
    ]


def _needed(
    group: Iterable[CellEntry], cells: Iterable[CellEntry], axes: Sequence[str]
) -> tuple[list[Mapping[str, str]], Held, list[str]]:
    """Return the axis values of all cells, those of the group by axis, and the axes that tell the two apart."""
    planned: list[Mapping[str, str]] = [*{cell.id: cell.axes for cell in cells if cell.base is None}.values()]
    held = {axis: {cell.axes.get(axis) for cell in group} for axis in axes}
    differing = [axis for axis in axes if held[axis] < {one[axis] for one in planned if one.get(axis)}]
    return planned, held, _telling(differing, held, planned)


def _telling(axes: Sequence[str], held: Held, planned: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the axes that are needed to describe the cells; redundant axes with most values are dropped first."""
    needed = list(axes)
    for axis in sorted(axes, key=lambda axis: -len(held[axis])):
        fewer = [one for one in needed if one != axis]
        if len(_inside(fewer, held, planned)) == len(_inside(needed, held, planned)):
            needed = fewer
    return needed


def _inside(axes: Iterable[str], held: Held, planned: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    return [one for one in planned if all(one.get(axis) in held[axis] for axis in axes)]


def _values(held: Sequence[str], every: Sequence[str]) -> str:
    """Return `1.0 or 1.2`, or `1.0 to 1.4` for consecutive versions; of many values that are no versions, the first."""
    start = every.index(held[0])
    versions = all(map(_parsed, held))
    if versions and len(held) >= RANGE and tuple(every[start : start + len(held)]) == tuple(held):
        return f"{held[0]} to {held[-1]}"
    shown = held if versions else held[:RANGE]
    return " or ".join(shown) + (f" or {len(held) - len(shown)} more" if len(held) > len(shown) else "")


def in_order(values: Iterable[str]) -> tuple[str, ...]:
    """Sort versions by age, after values that are no versions (`absent`), which keep their order."""
    distinct = dict.fromkeys(values)
    return tuple(sorted(distinct, key=lambda value: (_parsed(value) is not None, _parsed(value) or Version("0"))))


def _parsed(text: str) -> Version | None:
    try:
        return Version(text)
    except InvalidVersion:
        return None

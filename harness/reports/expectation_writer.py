"""Write expectations for red cells into a matrix file: choose the cells of each table, and its place.

A table is written for cells with the same verdict, phase and reason, and selects these and no other planned cells. It
goes before every table that would have matched one of them, because the first table that fits a cell counts. The text
around it stays as it is, comments included.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

from harness.judging.expectation import compare_expected
from harness.judging.known_failures import select_nameable
from harness.matrix.matrix_types import ExpectTable, Matrix
from harness.model import Cell, Phase, Verdict, cellid, schema
from harness.model.errors import BadInput
from harness.model.report_types import UNTOLD, CellEntry, word
from harness.model.vocabulary import When, alternatives, matcher
from harness.model.words import escape, recognise
from harness.reports.merging import natural

LONGEST = 160
"""Characters of a decisive line that an expectation repeats."""

HEADER = re.compile(r"[ \t]*\[")
EXPECT = re.compile(r"""[ \t]*\[\[[ \t]*(?:expect|"expect"|'expect')[ \t]*\]\]""")
INNER = re.compile(r"""[ \t]*\[+[ \t]*(?:expect|"expect"|'expect')[ \t]*\.""")


@dataclass(frozen=True, kw_only=True, slots=True)
class Wish:
    """The user's reason, link and end date for the expectations; `pattern` is the glob that chose the cells."""

    pattern: str
    reason: str
    link: str | None = None
    until: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Red:
    """The result of a cell, the same on every machine that could judge it; `lines` are the decisive lines."""

    cell: Cell
    verdict: Verdict
    phase: Phase | None
    lines: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Rewrite:
    """The new text of the file, its new tables, and a message for each table that was removed."""

    text: str
    tables: tuple[str, ...]
    replaced: tuple[str, ...]


# --- what is red -----------------------------------------------------------------------------------------------


def reds(cells: Iterable[Cell], entries: Mapping[str, Sequence[CellEntry]], today: str) -> tuple[list[Red], list[str]]:
    """Return the red cells without a valid expectation, and messages about others that cannot be expected."""
    red_cells, mixed = [], []
    for cell in cells:
        results = [entry for entry in entries.get(cell.id, ()) if entry.verdict not in UNTOLD]
        if not any(
            entry.verdict is not Verdict.WORKS and as_expected(cell, entry, today) != (True, None) for entry in results
        ):
            continue
        if len({(entry.verdict, entry.phase) for entry in results}) > 1:
            ends = ", ".join(f"{word(entry.verdict)} on {entry.machine}" for entry in results)
            mixed.append(f"{cell.id}: {ends}; no expectation fits them all")
            continue
        lines = sorted({entry.decisive for entry in results if entry.decisive})
        red_cells.append(Red(cell=cell, verdict=results[0].verdict, phase=results[0].phase, lines=tuple(lines)))
    return red_cells, mixed


def as_expected(cell: Cell, entry: CellEntry, today: str) -> tuple[bool | None, str | None]:
    """Return whether a result fits the matrix's present expectation, and why that is out of date, if it is."""
    return compare_expected(cell, entry, today, lambda: [one.signature for one in select_nameable(entry)])


# --- the tables ------------------------------------------------------------------------------------------------


def accept(text: str, matrix: Matrix, cells: Sequence[Cell], red_cells: Sequence[Red], wish: Wish) -> Rewrite:
    """Write tables for red cells into the text of a matrix file; `cells` are all planned cells."""
    groups: dict[tuple[Verdict, Phase | None, str, bool], list[Cell]] = {}
    for red in red_cells:
        groups.setdefault((red.verdict, red.phase, _line(red.lines), red.cell.base is None), []).append(red.cell)
    planned = [cell for cell in cells if cell.base is None]
    # Values of axes never select a changed cell (`ExpectTable.of_changed`), so each of them gets its label.
    tables = [
        _table(selector, verdict, phase, line, wish)
        for (verdict, phase, line, plain), group in groups.items()
        for selector in (_selectors(matrix, planned, group, wish.pattern) if plain else map(_labelled, group))
    ]
    accepted = {red.cell.id for red in red_cells}
    owned = _owned(matrix.expect, cells, matrix)
    gone = {index for index, ids in owned.items() if ids and ids <= accepted}
    catching = [
        index
        for index, table in enumerate(matrix.expect)
        if index not in gone and any(_fits(table, red.cell, matrix) for red in red_cells)
    ]
    replaced = tuple(
        f"expect[{index}] is gone, which spoke of these cells alone: {matrix.expect[index].reason}"
        for index in sorted(gone)
    )
    return Rewrite(
        text=_spliced(text, tables, gone, min(catching, default=None)), tables=tuple(tables), replaced=replaced
    )


def _line(lines: Sequence[str]) -> str:
    """Return the TOML keys that match these lines; empty if there are none.

    These are the code of our own sentence, else a regular expression that finds them all.
    """
    # A code still fits after the words of our sentence have changed; a pattern for these words would not.
    first, *others = [recognise(line) for line in lines] or [None]
    if first is None or any(other != first for other in others):
        match = "|".join(escape(_cut(line)) for line in lines)
        return f"match = {_string(match)}" if match else ""
    code, data = first
    values = ", ".join(f"{name} = {_string(value)}" for name, value in data.items() if len(value) <= LONGEST)
    return f"code = {_string(code)}" + (f"\ndata = {{ {values} }}" if values else "")


def _cut(line: str) -> str:
    first = line.partition("\n")[0]
    return first if len(first) <= LONGEST else first[:LONGEST].rpartition(" ")[0] or first[:LONGEST]


def _table(selector: str, verdict: Verdict, phase: Phase | None, line: str, wish: Wish) -> str:
    before = {"verdict": verdict.value, "phase": phase and phase.value}
    after = {"reason": wish.reason, "link": wish.link, "until": wish.until}
    first, last = ([f"{key} = {_string(value)}" for key, value in pairs.items() if value] for pairs in (before, after))
    return "\n".join(["[[expect]]", selector, *first, *([line] if line else []), *last, ""])


def _string(text: str) -> str:
    """Return a TOML string; with backslashes it is written in single quotes if possible."""
    if "\\" in text and "'" not in text and text.isprintable():
        return f"'{text}'"
    return schema.toml_value(text)


def _selectors(matrix: Matrix, cells: Sequence[Cell], group: Sequence[Cell], pattern: str) -> list[str]:
    """Return lines that together select exactly these cells.

    Tried in this order: values of one axis, one label, values of two axes, the user's pattern, several conditions.
    """
    ids = {cell.id for cell in group}
    one_axis, two = (_boxes(matrix, cells, group, axes) for axes in (1, 2))
    labels = [_labelled(cell) for cell in group]
    for selector in (one_axis, labels[0] if len(labels) == 1 else None, two):
        if selector:
            return [selector]
    if {cell.id for cell in cells if cellid.fits(pattern, cell)} == ids:
        return [f"cells = {_string(pattern)}"]
    return list(_parts(matrix, cells, group))


def _parts(matrix: Matrix, cells: Sequence[Cell], group: Sequence[Cell]) -> Iterator[str]:
    """Yield conditions that hold for these cells only, largest first; cells left over are selected by label."""
    left = {cell.id: cell for cell in group}
    inside = [
        (when, held)
        for when in _inside(matrix, cells, set(left))
        if (held := _held(when, cells, matrix)) <= left.keys()
    ]
    while inside:
        when, held = max(inside, key=lambda pair: (len(pair[1] & left.keys()), -len(pair[0])))
        if len(held & left.keys()) < 2:
            break
        yield _written(when)
        left = {name: cell for name, cell in left.items() if name not in held}
    yield from map(_labelled, left.values())


def _labelled(cell: Cell) -> str:
    return f"cells = {_string(cell.label)}"


def _inside(matrix: Matrix, cells: Sequence[Cell], ids: set[str]) -> Iterator[When]:
    """Yield conditions over two axes that hold for these cells only.

    Values of one axis are put together if they go with the same values of the other.
    """
    for down, across in permutations(matrix.axes, 2):
        squares: dict[str, dict[str, bool]] = {}
        for cell in cells:
            row = squares.setdefault(cell.axes[down], {})
            row[cell.axes[across]] = row.get(cell.axes[across], True) and cell.id in ids
        alike: dict[tuple[str, ...], list[str]] = {}
        for value, row in squares.items():
            fitting = tuple(other for other, fits in row.items() if fits)
            if fitting:
                alike.setdefault(() if len(fitting) == len(row) else fitting, []).append(value)
        for others, values in alike.items():
            only = {down: tuple(values)} if len(values) < len(squares) or not others else {}
            yield {**only, **({across: others} if others else {})}


def _boxes(matrix: Matrix, cells: Sequence[Cell], group: Sequence[Cell], count: int) -> str | None:
    """Return the first `when` over `count` axes that holds for exactly these cells, or None."""
    ids = {cell.id for cell in group}
    for axes in combinations(matrix.axes, count):
        when: When = {axis: tuple(dict.fromkeys(cell.axes[axis] for cell in group)) for axis in axes}
        if _held(when, cells, matrix) == ids:
            return _written(when)
    return None


def _held(when: When, cells: Iterable[Cell], matrix: Matrix) -> set[str]:
    return {cell.id for cell in cells if _holds(when, cell, matrix)}


def _written(when: When) -> str:
    keys = {axis: axis if re.fullmatch(r"[A-Za-z0-9_-]+", axis) else _string(axis) for axis in when}
    return "when = { " + ", ".join(f"{keys[axis]} = {_values(values)}" for axis, values in when.items()) + " }"


def _values(values: str | tuple[str, ...]) -> str:
    texts = [_string(value) for value in sorted(alternatives(values), key=natural)]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


# --- what a table speaks of ------------------------------------------------------------------------------------


def _owned(tables: Sequence[ExpectTable], cells: Iterable[Cell], matrix: Matrix) -> dict[int, set[str]]:
    """Return the ids of the cells that each table governs: the first table that fits a cell counts."""
    owned: dict[int, set[str]] = {index: set() for index in range(len(tables))}
    for cell in cells:
        first = next((index for index, table in enumerate(tables) if _fits(table, cell, matrix)), None)
        if first is not None:
            owned[first].add(cell.id)
    return owned


def _fits(table: ExpectTable, cell: Cell, matrix: Matrix) -> bool:
    if cell.base is not None and not table.of_changed:
        return False
    return (table.cells is None or cellid.fits(table.cells, cell)) and _holds(table.when, cell, matrix)


def _holds(when: When, cell: Cell, matrix: Matrix) -> bool:
    return all(
        any(matcher(matrix.axes[axis].kind, pattern)(cell.axes[axis]) for pattern in alternatives(patterns))
        for axis, patterns in when.items()
    )


# --- the text --------------------------------------------------------------------------------------------------


def _spliced(text: str, tables: Sequence[str], gone: set[int], before: int | None) -> str:
    """Return the text with tables inserted and others removed; a comment right above a table goes with it.

    Raises BadInput if the expectations are not written as [[expect]] tables.
    """
    end = "\r\n" if "\r\n" in text else "\n"
    # Lines keep their `\r`, so a file of another system keeps its line ends.
    lines = text.split("\n")
    blocks = list(_blocks(lines))
    if len(blocks) != len(tomllib.loads(text).get("expect", ())):
        message = "its expectations are not written as [[expect]] tables; write them so, and accept again"
        raise BadInput(message)
    at = blocks[before][0] if before is not None else max((stop for _, stop in blocks), default=len(lines))
    new = end.join(end.join(table.split("\n")) for table in tables).rstrip()
    dropped = {line for index in gone for line in _lines_of(lines, *blocks[index])}
    above = "\n".join(lines[line] for line in range(at) if line not in dropped).rstrip()
    below = "\n".join(lines[line] for line in range(at, len(lines)) if line not in dropped).strip("\r\n")
    return end.join([*([above, ""] if above else []), new, *(["", below] if below else []), ""])


def _blocks(lines: Sequence[str]) -> Iterator[tuple[int, int]]:
    """Yield the first line of each [[expect]] table, with the comment above it, and the line after its last one."""
    starts = [(_with_comment(lines, at), EXPECT.match(lines[at])) for at in _headers(lines)]
    for index, (start, mine) in enumerate(starts):
        if mine:
            yield start, starts[index + 1][0] if index + 1 < len(starts) else len(lines)


def _lines_of(lines: Sequence[str], start: int, stop: int) -> range:
    """Return the lines of a table without the blank lines and comments after it, except one blank line."""
    last = max(at for at in range(start, stop) if lines[at].strip() and not lines[at].lstrip().startswith("#"))
    return range(start, last + 1 + (last + 1 < stop and not lines[last + 1].strip()))


def _headers(lines: Sequence[str]) -> Iterator[int]:
    """Yield the lines that begin a table, except those inside expectations.

    A line counts only if the text since the last table is a complete TOML document.
    """
    last = 0
    for at, line in enumerate(lines):
        # A header inside a string of several lines is none. To parse the whole text at each header would take minutes
        # for a file with thousands of tables.
        if HEADER.match(line) and _is_toml("\n".join([*lines[last:at], ""])):
            last = at
            if not INNER.match(line):
                yield at


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


def _with_comment(lines: Sequence[str], at: int) -> int:
    while at and lines[at - 1].lstrip().startswith("#"):
        at -= 1
    return at


# --- whether it came out right ---------------------------------------------------------------------------------


def trouble(
    before: Sequence[Cell], after: Sequence[Cell], accepted: Iterable[str], judge: Callable[[Cell], list[Any]]
) -> str | None:
    """Return the first fault of the new expectations in words, or None if there is none.

    `judge` returns how the results of a cell stand by its expectation.
    """
    chosen, before_by_id = set(accepted), {cell.id: cell for cell in before}
    if before_by_id.keys() != {cell.id for cell in after}:
        return "other cells are planned"
    for cell in after:
        if cell.id not in chosen and cell.expect != before_by_id[cell.id].expect:
            return f"something else is expected of {cell.id}"
        if cell.id in chosen and any(standing not in {(True, None), (None, None)} for standing in judge(cell)):
            return f"{cell.id} is still not as expected"
    return None

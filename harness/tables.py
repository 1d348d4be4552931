"""Regroups the report document into tables: plain data, ready to be presented in any form."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from harness import explaining, grouping
from harness.errors import BadInput
from harness.model import Verdict
from harness.reporttypes import (
    SEVERITY,
    CaseEntry,
    CellEntry,
    Document,
    MatrixEntry,
    Pivot,
    Remark,
    Report,
    Row,
    Sheet,
    Square,
)
from harness.vocabulary import READERS

NOTHING = "-"


def report(document: Document, pivot: tuple[str, str] | None = None) -> Report:
    """Everything that a presentation shows; `pivot` names the axes of the small table, down and across."""
    matrices = {name: document.matrices.get(name) or _guessed(document.cells, name) for name in _names(document)}
    check_pivot(pivot, [matrix.axes for matrix in matrices.values()])
    return Report(
        generated=document.generated,
        sheets=tuple(_sheet(document, name, matrix, pivot) for name, matrix in matrices.items()),
        machines=tuple((name, _facts(facts)) for name, facts in sorted(document.machines.items())),
        stale=document.stale,
    )


def check_pivot(pivot: Sequence[str] | None, axes: Sequence[Sequence[str]]) -> None:
    """Refuse two names that are not axes of one of the matrices; `axes` are those of each."""
    if pivot and not any(set(pivot) <= set(names) for names in axes):
        known = sorted({name for names in axes for name in names})
        message = f"--pivot {' '.join(pivot)}: takes two axes of one matrix; known here: {', '.join(known) or 'none'}"
        raise BadInput(message)


def _names(document: Document) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*document.matrices, *(cell.matrix for cell in document.cells))))


def _guessed(cells: Iterable[CellEntry], name: str) -> MatrixEntry:
    """The axes of a matrix that the document does not describe: those of its cells."""
    return MatrixEntry(axes=tuple(dict.fromkeys(axis for cell in cells if cell.matrix == name for axis in cell.axes)))


def _sheet(document: Document, name: str, matrix: MatrixEntry, pivot: tuple[str, str] | None) -> Sheet:
    cells = [cell for cell in document.cells if cell.matrix == name]
    machines = tuple(sorted({cell.machine for cell in cells if cell.machine})) or (NOTHING,)
    columns = tuple(dict.fromkeys((*matrix.axes, *matrix.shown)))
    counts = Counter(cell.verdict for cell in cells)
    asked = pivot if pivot and set(pivot) <= set(matrix.axes) else matrix.pivot
    chosen = asked or _default_axes(matrix.axes, cells)
    dropped = [(gone.reason, "", gone.id) for gone in document.dropped if gone.id.partition("/")[0] == name]
    found = [
        (finding.text, f"{finding.check}, {finding.level}", cell.id) for cell in cells for finding in cell.findings
    ]
    locks = [(cell.lock, "", cell.id) for cell in cells if cell.lock]
    return Sheet(
        matrix=name,
        cells=len({cell.id for cell in cells}),
        results=len(cells),
        machines=machines,
        counts=tuple((verdict, counts[verdict]) for verdict in reversed(SEVERITY) if counts[verdict]),
        pivot=_pivot([cell for cell in cells if cell.base is None], chosen, machines) if chosen else None,
        columns=columns,
        rows=_rows(cells, columns, machines),
        troubles=grouping.troubles(cells, matrix.axes),
        findings=_grouped(found),
        dropped=_grouped(dropped),
        left_out=sum(gone.count for gone in document.dropped if gone.id.partition("/")[0] == name),
        locks=_grouped(locks),
        attempts=tuple(explaining.attempts(cells)),
        drawing=_grouped((text, about, cell.id) for cell in cells for about, text in _drawing(cell)),
        repairs=_grouped((_repaired(one), str(one["link"]), cell.id) for cell in cells for one in cell.repairs),
    )


def _drawing(cell: CellEntry) -> Iterator[tuple[str, str]]:
    """Of a cell with frames: what drew them, and what a user has to set for them, too; each with what it is."""
    drawn = [case for case in cell.cases if case.frames]
    for words in dict.fromkeys(context(case) for case in drawn if case.drawn):
        yield "what drew", words
    yield from (("to be set", words) for words in (settings(cell.supplied, cell.installed or {}) if drawn else ()))


def settings(supplied: Mapping[str, str], installed: Iterable[str]) -> tuple[str, ...]:
    """What of the variables that the harness supplied matters to the packages that are there: `NAME=value` of each."""
    there = {*installed}
    return tuple(
        f"{name}={value}"
        for name, value in supplied.items()
        if (readers := READERS.get(name)) is None or readers & there
    )


def context(case: CaseEntry) -> str:
    """What drew the frames of a case, in words."""
    return ", ".join(
        case.drawn[part] for part in ("api", "renderer", "vendor", "version", "device") if part in case.drawn
    )


def _rows(cells: Iterable[CellEntry], columns: Sequence[str], machines: Sequence[str]) -> tuple[Row, ...]:
    """A row for each result; what several machines found alike is one."""
    rows = [_row(cell, columns) for cell in cells]
    if len(machines) == 1:
        return tuple(rows)
    alike: dict[Row, list[Row]] = {}
    for row in rows:
        alike.setdefault(replace(row, machine="", seconds=0.0), []).append(row)
    return tuple(
        replace(
            row, seconds=max(one.seconds for one in found), machine=_named([one.machine for one in found], machines)
        )
        for row, found in alike.items()
    )


def _named(found: Sequence[str], machines: Sequence[str]) -> str:
    return "every machine" if len(found) == len(machines) else ", ".join(found)


def _row(cell: CellEntry, columns: Sequence[str]) -> Row:
    return Row(
        id=cell.id,
        label=explaining.label(cell.id),
        verdict=cell.verdict,
        as_expected=cell.as_expected,
        phase=explaining.failed_in(cell),
        why=_why(cell),
        hidden_by=explaining.hidden_by(cell),
        expected="" if explaining.plain(cell) else explaining.expectation(cell),
        versions=tuple(_version(cell, column) for column in columns),
        findings=len(cell.findings),
        seconds=cell.seconds,
        machine=cell.machine or NOTHING,
        repaired=tuple(f"{repair['package']} {repair['version']}" for repair in cell.repairs),
        **explaining.told(cell),
    )


def _repaired(repair: Mapping[str, Any]) -> str:
    """What was changed of a release, and why."""
    changes = ", ".join(f"`{edit['field']}: {edit['from']}` to `{edit['to']}`" for edit in repair["edits"])
    return f"{repair['package']} {repair['version']}, {changes}: {repair['reason']}"


def _version(cell: CellEntry, column: str) -> str:
    """What is installed, else what was asked for."""
    if column == "python":
        return cell.python or cell.requested_python
    asked = cell.axes.get(column, cell.environment.get(column, NOTHING))
    return (cell.installed or {}).get(column, asked)


def _why(cell: CellEntry) -> str:
    """The decisive line, with the environment it came from where there are others; or what could not be shown."""
    if cell.unverified:
        reasons = dict.fromkeys(case.decisive for case in cell.cases if case.decisive)
        return f"not verified: {', '.join(cell.unverified)}" + (f" ({'; '.join(reasons)})" if reasons else "")
    hit = [case for case in cell.cases if case.decisive and case.decisive == cell.decisive]
    if hit and len(hit) < len(cell.cases):
        distinct = len({case.env for case in hit}) == len(hit)
        return f"{', '.join((distinct and case.env) or case.case for case in hit)}: {cell.decisive}"
    return cell.decisive or ""


# --- the pivot -------------------------------------------------------------------------------------------------


def _default_axes(axes: Sequence[str], cells: Sequence[CellEntry]) -> tuple[str, str] | None:
    """The first two axes that vary, Python last, else one that does and any other; None where nothing varies."""
    varying = [axis for axis in axes if len({cell.axes.get(axis) for cell in cells}) > 1]
    if len(axes) < 2 or not varying:
        return None
    if len(varying) > 2 and "python" in varying:
        varying.remove("python")
    down = varying[0]
    return down, (varying[1:] or [axis for axis in axes if axis != down])[0]


def _pivot(cells: Sequence[CellEntry], axes: tuple[str, str], machines: Sequence[str]) -> Pivot:
    down, across = axes
    rows, columns = (grouping.in_order(cell.axes.get(axis, NOTHING) for cell in cells) for axis in axes)
    met: dict[tuple[str, str], list[CellEntry]] = {}
    for cell in cells:
        met.setdefault((cell.axes.get(down, NOTHING), cell.axes.get(across, NOTHING)), []).append(cell)
    squares = tuple(tuple(_square(met.get((row, column), ()), machines) for column in columns) for row in rows)
    return Pivot(down=down, across=across, rows=rows, columns=columns, squares=squares)


def _square(cells: Sequence[CellEntry], machines: Sequence[str]) -> tuple[Square, ...]:
    """One entry per machine; a cell without a result there was not run there."""
    if not cells:
        return ()
    known = {(cell.id, cell.machine or NOTHING): cell.verdict for cell in cells}
    ids = dict.fromkeys(cell.id for cell in cells)
    return tuple(_worst(one, [known.get((cell_id, one), Verdict.NOT_RUN) for cell_id in ids]) for one in machines)


def _worst(machine: str, verdicts: Sequence[Verdict]) -> Square:
    run = [verdict for verdict in verdicts if verdict is not Verdict.NOT_RUN]  # what was not run hides nothing
    worst = min(run or verdicts, key=SEVERITY.index)
    return Square(machine=machine, verdict=worst, count=verdicts.count(worst), total=len(verdicts))


# --- what needs words ------------------------------------------------------------------------------------------


def _grouped(said: Iterable[tuple[str, str, str]]) -> tuple[Remark, ...]:
    """(text, what it is about, cell id), equal ones together, those of most cells first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for text, about, cell_id in said:
        groups.setdefault((about, text), []).append(explaining.label(cell_id))
    remarks = [Remark(about=about, text=text, cells=tuple(dict.fromkeys(ids))) for (about, text), ids in groups.items()]
    return tuple(sorted(remarks, key=lambda remark: -len(remark.cells)))


def _facts(facts: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Facts of a machine as words; what is not known is left out."""
    told = {name.replace("_", " "): _words(fact) for name, fact in sorted(facts.items())}
    return tuple((name, words) for name, words in told.items() if words)


def _words(fact: Any) -> str:
    match fact:
        case None:
            return ""
        case {"missing": why}:
            return f"none ({why})"
        case dict():
            return ", ".join(str(value) for _, value in sorted(fact.items()))  # report.json keeps no other order
        case list() | tuple():
            return ", ".join(map(_words, fact))
        case _:
            return str(fact)

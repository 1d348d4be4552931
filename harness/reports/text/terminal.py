"""Print a report on a terminal, at its width. Nothing is computed here: `tables` has grouped everything shown."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from harness.machine.console import limit_width
from harness.model import Role, Verdict, replace
from harness.model.report_types import SYMBOLS, UNTOLD, format_count, word
from harness.reports.tables.table_types import Attempt, Effect, Pivot, Remark, Report, Row, Sheet, Square, Trouble
from harness.reports.text import cause_markdown, report_markdown
from harness.standalone.control_characters import strip_controls
from harness.standalone.output import style_stream

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.text import Text

LISTED = 60
"""Cells, or rows of the small table, of which every one is shown on a terminal; of more, the green are counted."""

REFERENCES = 3
"""Links of a cause that a terminal shows; the Markdown report has all."""

TASKS = 12
"""Tasks that a terminal names; the Markdown report has all."""

PIPED_WIDTH = 100
"""Columns where the output is no terminal and COLUMNS says nothing."""

"""Columns of a console at most."""

WIDEST, WIDEST_NAME = 18, 28
"""Columns of the small print of a square or of a head, and of a row's name, before it is broken into lines."""

GREEN, YELLOW, RED, GREY = "green", "yellow", "red", "bright_black"
INDENT = 2
EFFECTS = {Effect.CURES: GREEN, Effect.BREAKS: RED, Effect.NOTHING: GREY, Effect.UNTOLD: GREY}


def show(report: Report, console: Console | None = None) -> None:
    """Print the whole report on the terminal (stdout unless another console is given), at its width."""
    target = console or _console()
    for sheet in report.sheets:
        _print(target, _sheet(sheet, target))
    for sentence in report.stale:
        target.print(_styled((f"out of date: {sentence}", YELLOW)))
    for machine, facts in report.machines:
        words = "; ".join(f"{name} {fact}" for name, fact in facts)
        target.print(_styled((f"measured on {machine}" + (f": {words}" if words else ""), GREY)))


def show_overview(report: Report, console: Console | None = None) -> None:
    """Print how many combinations work of each matrix, and nothing else of it."""
    target = console or _console()
    for sheet in report.sheets:
        target.print(_heading(sheet))
        target.print(_padded(_styled((report_markdown.result(sheet), ""))))
    for sentence in report.stale:
        target.print(_styled((f"out of date: {sentence}", YELLOW)))


def show_summary(report: Report, console: Console | None = None) -> None:
    """Print how many combinations work, and the small table, of each matrix."""
    target = console or _console()
    for sheet in report.sheets:
        _print(target, _summary(sheet, target))


def _print(target: Console, parts: Iterable[RenderableType]) -> None:
    for part in parts:
        target.print(part)


def _console() -> Console:

    from rich.console import Console  # noqa: PLC0415 - start-up

    columns = os.environ.get("COLUMNS", "")
    width_known = sys.stdout.isatty() or (columns.isdigit() and int(columns) > 0)
    # Without a width rich takes that of the terminal, or COLUMNS. Markup is off because lines of packages may hold
    # square brackets, which rich would obey.
    console = Console(
        file=style_stream(sys.stdout), highlight=False, markup=False, width=None if width_known else PIPED_WIDTH
    )
    return limit_width(console)


# --- one matrix ------------------------------------------------------------------------------------------------


def _summary(sheet: Sheet, target: Console) -> Iterable[RenderableType]:
    yield _heading(sheet)
    yield _styled((report_markdown.result(sheet), "bold"))
    yield ""
    if sheet.pivot:
        yield from _small_tables(sheet.pivot, target)
        yield _padded(_styled((report_markdown.legend(sheet.pivot).replace("`", ""), GREY)))
        yield ""


def _sheet(sheet: Sheet, target: Console) -> Iterable[RenderableType]:
    yield from _summary(sheet, target)
    if sheet.tasks:
        yield from _tasks(sheet)
    yield from _list(sheet)
    yield ""
    if any(one.known or one.cells > 1 for one in sheet.troubles):
        yield from _troubles(sheet.troubles)
    if sheet.attempts:
        yield from _attempts(sheet.attempts)
    if sheet.repairs:
        yield from _remarks("patched: these releases cannot be installed as published", sheet.repairs)
    if sheet.drawing:
        yield from _remarks("images: renderer used, and the variables to set to get them", sheet.drawing)
    if sheet.findings:
        yield from _remarks("findings: nothing here stops a training loop", sheet.findings)
    if sheet.dropped:
        yield from _remarks("left out", sheet.dropped)


def _heading(sheet: Sheet) -> Text:
    parts: list[tuple[str, str]] = [
        (f"{sheet.matrix}: {sheet.title}", "bold"),
        (f"  {report_markdown.results(sheet)}", ""),
    ]
    for verdict, count in sheet.counts:
        parts += [("   ", ""), (f"{SYMBOLS[verdict]} {count} {word(verdict)}", _colour(verdict))]
    return _styled(*parts)


def _tasks(sheet: Sheet) -> Iterable[RenderableType]:
    """Yield each task with the number of cells in which it passed, of those that tried it."""
    words = [f"{one.name} {one.passed}/{one.tried}" for one in sheet.tasks[:TASKS]]
    more = [f"and {len(sheet.tasks) - TASKS} more"] * (len(sheet.tasks) > TASKS)
    yield _styled(("tried: ", "bold"), (", ".join([*words, *more]), ""))
    yield ""


# --- the small table -------------------------------------------------------------------------------------------


def _small_tables(pivot: Pivot, target: Console) -> Iterable[RenderableType]:
    """Yield the table in a form that fits: as it is, else turned, else in the fewest blocks of columns."""
    room = target.width - INDENT
    ways = (pivot, _turned(pivot))
    shown = next((one for one in ways if _fits(one, 0, len(one.columns), target, room)), None)
    if shown is None:
        shown = min(ways, key=lambda way: len(_blocks(way, target, room)))
    for first, last in _blocks(shown, target, room):
        yield _padded(_table(shown, first, last))
    if hidden := len(shown.rows) - len(_shown(shown)):
        yield _padded(_styled((f"{format_count(hidden, 'more row')} in which all works", GREY)))


def _turned(pivot: Pivot) -> Pivot:
    return replace(
        pivot,
        down=pivot.across,
        across=pivot.down,
        rows=pivot.columns,
        columns=pivot.rows,
        squares=tuple(zip(*pivot.squares, strict=True)),
    )


def _blocks(pivot: Pivot, target: Console, room: int) -> list[tuple[int, int]]:
    """Cut the columns into blocks that are no wider than the room, each with as many columns as fit."""
    blocks, first = [], 0
    while first < len(pivot.columns):
        last = first + 1
        while last < len(pivot.columns) and _fits(pivot, first, last + 1, target, room):
            last += 1
        blocks.append((first, last))
        first = last
    return blocks


def _fits(pivot: Pivot, first: int, last: int, target: Console, room: int) -> bool:
    """Return whether these columns, beside the names of the rows, are no wider than the room."""
    from rich.measure import Measurement  # noqa: PLC0415 - start-up

    if last - first > room:  # a column is a character wide at least
        return False
    # rich never measures more than the width it is given, so a table that is too wide would seem to fit.
    endless = target.options.update(max_width=10_000)
    return Measurement.get(target, endless, _table(pivot, first, last)).maximum <= room


def _table(pivot: Pivot, first: int, last: int) -> RenderableType:
    from rich import box  # noqa: PLC0415 - start-up
    from rich.table import Table  # noqa: PLC0415 - start-up

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="bold", padding=(0, 1, 0, 0))
    table.add_column(_wrap_words(f"{pivot.down} \\ {pivot.across}"))
    for column in pivot.columns[first:last]:
        table.add_column(_wrap_words(column), justify="center", no_wrap=True)
    for name, squares in _shown(pivot):
        if not any(squares[first:last]):
            continue
        head = _styled((_wrap_words(name, WIDEST_NAME), "bold"))
        table.add_row(head, *(_square(pivot, square) for square in squares[first:last]))
    return table


def _shown(pivot: Pivot) -> list[tuple[str, tuple[tuple[Square, ...], ...]]]:
    """Return the rows; of more than `LISTED` rows, those in which something does not work."""
    rows = list(zip(pivot.rows, pivot.squares, strict=True))
    if len(rows) <= LISTED:
        return rows
    return [row for row in rows if any(one.verdict is not Verdict.WORKS for square in row[1] for one in square)]


def _square(pivot: Pivot, square: Sequence[Square]) -> Text:
    """Return the sign and the tasks of each verdict, with its small print below."""
    lines: list[tuple[str, str]] = []
    for entry in square:
        lines.append((report_markdown.mark(pivot, entry), _colour(entry.verdict)))
        lines += [(line, GREY) for line in _wrap_words(report_markdown.small(pivot, entry)).splitlines()]
    return _styled(*((("\n" if place else "") + line, style) for place, (line, style) in enumerate(lines)))


def _wrap_words(text: str, widest: int = WIDEST) -> str:
    """Break a text into lines after spaces and hyphens, none longer than `widest` if it can be helped."""
    lines = [""]
    for piece in text.replace(" ", " \0").replace("-", "-\0").split("\0"):
        if lines[-1] and len(lines[-1] + piece.rstrip()) > widest:
            lines.append("")
        lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)


# --- the cells -------------------------------------------------------------------------------------------------


def _list(sheet: Sheet) -> Iterable[RenderableType]:
    """Yield the cells: verdict, name, installed versions, and the decisive line.

    Of more than `LISTED` cells, those with nothing to say are only counted.
    """
    quiet = {Verdict.WORKS, Verdict.NOT_RUN}
    telling = [row for row in sheet.rows if row.verdict not in quiet or row.as_expected is False or row.why]
    rows = sheet.rows if len(sheet.rows) <= LISTED else telling
    for row in rows:
        yield _verdict(row)
        yield _padded(_details(sheet, row))
    if len(rows) < len(sheet.rows):
        more = format_count(len(sheet.rows) - len(rows), "more cell")
        yield _styled((f"{more} of which there is nothing to say; the Markdown report lists them", GREY))


def _verdict(row: Row) -> Text:
    """Return `✘ broken in single, patched  0/4 tasks, 17.5 s`."""
    notes = ["patched"] * bool(row.repaired) + [str(row.role)] * (row.role is not Role.MAIN)
    phase = f" in {row.phase}" if row.phase else ""
    measured = [f"{row.passed}/{row.tried} tasks"] * bool(row.tried)
    measured += [f"{row.seconds:.1f} s"] * (row.verdict is not Verdict.NOT_RUN)
    measured += [format_count(row.findings, "finding")] * bool(row.findings)
    return _styled(
        (f"{SYMBOLS[row.verdict]} {word(row.verdict)}", f"bold {_colour(row.verdict)}"),
        (", ".join([phase, *notes]), ""),
        (f"  {', '.join(measured)}", GREY),
    )


def _details(sheet: Sheet, row: Row) -> Text:
    versions = ", ".join(f"{name} {version}" for name, version in zip(sheet.columns, row.versions, strict=True))
    where = f"\non {row.machine}" if len(sheet.machines) > 1 and row.verdict is not Verdict.NOT_RUN else ""
    parts = [(row.label, ""), (f"\n{versions}{where}", GREY)]
    if row.why:
        parts.append((f"\n{row.why}", "" if row.verdict is Verdict.WORKS else _colour(row.verdict)))
    if row.suite:
        parts.append((f"\nown tests: {row.suite}", ""))
    parts += [(f"\nhid behind {mask}", GREY) for mask in row.hidden_by]
    if row.known:
        fix = f"\nfix: {cause_markdown.first_sentence(row.remedy)}"
        parts += [(f"\nknown as {row.known}", ""), (fix, GREEN if row.proven else "")]
    if row.expected:
        parts.append((f"\n{row.expected}", "bold" if row.as_expected is False else GREY))
    return _styled(*parts)


# --- what needs words ------------------------------------------------------------------------------------------


def _troubles(troubles: Iterable[Trouble]) -> Iterable[RenderableType]:
    """Yield one paragraph per cause, with its fix and links."""
    yield _styled(("by cause", "bold"))
    for trouble in troubles:
        head = (
            f"{cause_markdown.describe_results(trouble)}: {trouble.where.replace('`', '')}",
            _colour(trouble.verdicts[0][0]),
        )
        parts = [head, (f"\n{_cause(trouble)}", "")]
        if trouble.remedy:
            proof = f" ({cause_markdown.proven(trouble)})" if cause_markdown.proven(trouble) else ""
            parts.append((f"\nfix: {trouble.remedy}{proof}".replace("`", ""), GREEN if trouble.proofs else ""))
        parts += [(f"\n{link}", GREY) for link in trouble.references[:REFERENCES]]
        yield _padded(_styled(*parts))
    yield ""


def _cause(trouble: Trouble) -> str:
    """Return the known failure, else the reason that the matrix gives, else the decisive line."""
    if trouble.known:
        return f"{trouble.known}: {trouble.cause}"
    lead = cause_markdown.unknown(trouble)
    return (
        f"{lead}; the matrix says: {trouble.cause}"
        if trouble.cause
        else f"{lead}: {trouble.line}"
        if trouble.line
        else lead
    )


def _attempts(attempts: Iterable[Attempt]) -> Iterable[RenderableType]:
    yield _styled(("changes tried, one at a time", "bold"))
    for tried in report_markdown.by_cell(attempts):
        yield _padded(_styled((tried[0].cell, ""), (f"\n{tried[0].before}", GREY)))
        for attempt in tried:
            words = f": {'; '.join(attempt.does)}{' (advice)' if attempt.advice else ''}\n{attempt.after}"
            head = (f"{attempt.effect}: {attempt.change}", EFFECTS.get(attempt.effect, YELLOW))
            yield _padded(_styled(head, (words, GREY)), 2 * INDENT)
    yield ""


def _remarks(title: str, remarks: Iterable[Remark]) -> Iterable[RenderableType]:
    yield _styled((title, "bold"))
    for remark in remarks:
        about = f" ({remark.about})" if remark.about else ""
        count = format_count(remark.count, "combination") if remark.count else format_count(len(remark.cells), "cell")
        where = remark.cells[0] if len(remark.cells) == 1 and remark.count < 2 else count
        yield _padded(_styled((remark.text, ""), (f"{about}: {where}", GREY)))
    yield ""


# --- text ------------------------------------------------------------------------------------------------------


def _padded(part: RenderableType, indent: int = INDENT) -> RenderableType:
    from rich.padding import Padding  # noqa: PLC0415 - start-up

    return Padding(part, (0, 0, 0, indent))


def _styled(*parts: tuple[str, str]) -> Text:
    from rich.text import Text  # noqa: PLC0415 - start-up

    # `styled` lets escape sequences through for the colours of rich, so those of packages are removed here.
    # `fold` wraps a long word, which a table of rich would cut off.
    return Text.assemble(*((strip_controls(text), style) for text, style in parts), overflow="fold")


def _colour(verdict: Verdict) -> str:
    if verdict is Verdict.WORKS:
        return GREEN
    if verdict in UNTOLD:
        return GREY
    return YELLOW if verdict is Verdict.PARTIAL else RED

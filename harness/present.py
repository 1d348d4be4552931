"""A report as Markdown and on a terminal. Nothing is computed here: what is shown was grouped by `tables`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from harness.model import Verdict
from harness.reporttypes import (
    SYMBOLS,
    UNTOLD,
    Attempt,
    Effect,
    Pivot,
    Remark,
    Report,
    Row,
    Sheet,
    Square,
    Trouble,
    number,
    word,
)

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.text import Text

TEMPLATE = "report.md.j2"

LISTED = 60
"""Cells, or rows of the small table, of which every one is shown on a terminal; of more, the green are counted."""

REFERENCES = 3
"""Links of a cause that a terminal shows; the Markdown report has all."""

PIPED_WIDTH = 100
"""Columns where the output is no terminal."""

GREEN, YELLOW, RED, GREY = "green", "yellow", "red", "bright_black"
INDENT = 2
EFFECTS = {Effect.CURES: GREEN, Effect.BREAKS: RED, Effect.NOTHING: GREY, Effect.UNTOLD: GREY}


def markdown(report: Report, template: str) -> str:
    """Fill the template (the text of `templates/report.md.j2`)."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - start-up

    environment = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True, autoescape=False)
    environment.filters |= filters()
    return environment.from_string(template).render(report=report)


def filters() -> dict[str, Callable[..., Any]]:
    """What templates may do with the values of a report."""
    return {
        "became": _became,
        "by_cell": by_cell,
        "cause": _cause,
        "cause_in_short": _cause_in_short,
        "cell": _table_cell,
        "codes": _codes,
        "counts": _counts,
        "first_sentence": _first_sentence,
        "named": lambda verdict: f"{SYMBOLS[verdict]} {word(verdict)}",
        "number": number,
        "proven": _proven,
        "reference": _reference,
        "rule": lambda columns, mark: " | ".join(mark for _ in columns),
        "table": small_table,
        "unknown": _unknown,
        "results": _results,
        "seen_in": lambda labels, cells: _codes(labels) if len(labels) < cells else f"all {number(cells, 'cell')}",
        "sentence": lambda text: f"{text[:1].upper()}{text[1:].rstrip('.')}.",
    }


def small_table(pivot: Pivot) -> str:
    """The table over two axes as Markdown, its lines ended."""
    head = [f"{_table_cell(pivot.down)} ╲ {_table_cell(pivot.across)}", *map(_table_cell, pivot.columns)]
    rows = [
        [_table_cell(name), *map(_square, squares)] for name, squares in zip(pivot.rows, pivot.squares, strict=True)
    ]
    lines = [head, ["---", *(":-:" for _ in pivot.columns)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _results(sheet: Sheet) -> str:
    """`6 cells`, or `6 cells, 11 results on 2 machines`."""
    cells, machines = number(sheet.cells, "cell"), len(sheet.machines)
    return cells if machines == 1 else f"{cells}, {number(sheet.results, 'result')} on {number(machines, 'machine')}"


def _counts(sheet: Sheet) -> str:
    """`✔ 6 works, ✘ 2 broken; 3 combinations left out.`"""
    counts = ", ".join(f"{SYMBOLS[verdict]} {count} {word(verdict)}" for verdict, count in sheet.counts)
    return counts + (f"; {number(sheet.left_out, 'combination')} left out." if sheet.left_out else ".")


def _became(one: Trouble) -> str:
    """`◐ 2 partial, ✘ broken in single`: what became of the cells of a cause."""
    several = len(one.verdicts) > 1
    verdicts = ", ".join(
        f"{SYMBOLS[each]} {f'{count} ' if several else ''}{word(each)}" for each, count in one.verdicts
    )
    return verdicts + (f" in {', '.join(one.phases)}" if one.phases else "")


def _cause(row: Row) -> str:
    """The known cause of a cell, linked to where more is said, and whether its remedy is proven there."""
    return f"[`{row.known}`](#{row.known}){', remedy proven' if row.proven else ''}" if row.known else ""


def _cause_in_short(one: Trouble) -> str:
    """The known failure with its first sentence, else what the matrix says, else the line."""
    if one.known:
        return f"[`{one.known}`](#{one.known}): {_first_sentence(one.cause)}"
    lead = _unknown(one)
    return f"{lead}; the matrix says: {one.cause}" if one.cause else f"{lead}: {one.line}" if one.line else lead


def _unknown(one: Trouble) -> str:
    """What stands for a cause where no known failure fits."""
    verdict = one.verdicts[0][0]
    return "it works" if verdict is Verdict.WORKS else word(verdict) if verdict in UNTOLD else "not known"


def _first_sentence(text: str) -> str:
    """Up to the first full stop that ends one; with a lead of its own line by line."""
    found = re.match(r".*?[^.][.](?= [A-Z`(]|$)", text)
    return (found[0] if found else text).removesuffix(".")


def _proven(one: Trouble) -> str:
    """By which cell the remedy is proven, and for how many of them where not for all; or that it is not."""
    if one.proofs:
        return f"by `{one.proofs[0][0]}`" + (f", for {one.proven} of {one.cells}" if one.proven < one.cells else "")
    return "no" if one.applicable else "-"


def _reference(link: str) -> str:
    """A link as short as it can be: `owner/name#12`, else its host."""
    found = re.match(r"https?://(?:www\.)?([^/]+)(?:/([^/]+/[^/]+)/(?:issues|pull|discussions)/(\d+))?", link)
    text = (f"{found[2]}#{found[3]}" if found[3] else found[1]) if found else link
    return f"[{text}]({link})"


def _codes(labels: Iterable[str]) -> str:
    return ", ".join("`" + label.replace(" on ", "` on `") + "`" for label in labels)


def _table_cell(text: str) -> str:
    """Text that stays in one cell of a Markdown table."""
    return " ".join(text.split()).replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def _square(square: Sequence[Square]) -> str:
    """`✘ 2/3`: the worst verdict per machine, and how many of how many cells have it where not all do."""
    return "  ".join(
        SYMBOLS[one.verdict] + (f" {one.count}/{one.total}" if one.count != one.total else "") for one in square
    )


# --- the terminal ----------------------------------------------------------------------------------------------


def print_terminal(report: Report, console: Console | None = None) -> None:
    """Print the whole report on the terminal (stdout unless another console is given), at its width."""
    target = console or _console()
    for sheet in report.sheets:
        for part in _sheet(sheet):
            target.print(part)
    for sentence in report.stale:
        target.print(_styled((f"out of date: {sentence}", YELLOW)))
    for machine, facts in report.machines:
        told = "; ".join(f"{name} {fact}" for name, fact in facts)
        target.print(_styled((f"measured on {machine}" + (f": {told}" if told else ""), GREY)))


def _console() -> Console:
    import sys  # noqa: PLC0415 - start-up

    from rich.console import Console  # noqa: PLC0415 - start-up

    class Terminal(Console):
        """One that leaves it to the command what the end of a pipe means; Rich would exit with 1."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Terminal(highlight=False, markup=False, width=None if sys.stdout.isatty() else PIPED_WIDTH)


def _sheet(sheet: Sheet) -> Iterable[RenderableType]:
    yield _heading(sheet)
    yield ""
    if sheet.pivot:
        yield _pivot_table(sheet.pivot)
        if len(sheet.machines) > 1:
            yield _styled((f"{' ' * INDENT}in each square, from left to right: {', '.join(sheet.machines)}", GREY))
        yield ""
    yield _list(sheet)
    yield ""
    if any(one.known or one.cells > 1 for one in sheet.troubles):
        yield from _troubles(sheet.troubles)
    if sheet.attempts:
        yield from _attempts(sheet.attempts)
    if sheet.repairs:
        yield from _remarks("repaired: no resolver accepts them as the index has them", sheet.repairs)
    if sheet.drawing:
        yield from _remarks("frames: what drew them, and what was set for them to appear", sheet.drawing)
    if sheet.findings:
        yield from _remarks("findings, which stop no user's loop", sheet.findings)
    if sheet.dropped:
        yield from _remarks("left out", sheet.dropped)


def _heading(sheet: Sheet) -> Text:
    parts: list[tuple[str, str]] = [(sheet.matrix, "bold"), (f"  {_results(sheet)}", "")]
    for verdict, count in sheet.counts:
        parts += [("   ", ""), (f"{SYMBOLS[verdict]} {count} {word(verdict)}", _colour(verdict))]
    return _styled(*parts)


def _pivot_table(pivot: Pivot) -> RenderableType:
    from rich import box  # noqa: PLC0415 - start-up
    from rich.padding import Padding  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="bold")
    table.add_column(f"{pivot.down} \\ {pivot.across}", no_wrap=True)
    for column in pivot.columns:
        table.add_column(column, justify="center")
    rows = list(zip(pivot.rows, pivot.squares, strict=True))
    shown = rows if len(rows) <= LISTED else [row for row in rows if not _green(row[1])]
    for name, squares in shown:
        table.add_row(_styled((name, "bold")), *map(_square_text, squares))
    if len(shown) < len(rows):
        table.add_row(_styled((f"{number(len(rows) - len(shown), 'more row')} in which all works", GREY)))
    return Padding(table, (0, 0, 0, INDENT))


def _green(squares: Iterable[Sequence[Square]]) -> bool:
    """Whether all that was tried in a row works."""
    return all(one.verdict is Verdict.WORKS for square in squares for one in square)


def _square_text(square: Sequence[Square]) -> Text:
    parts = [(_square([one]), _colour(one.verdict)) for one in square]
    return _styled(*(piece for part in parts for piece in (part, ("  ", ""))))


def _list(sheet: Sheet) -> RenderableType:
    """The cells: verdict, name, what was installed, and the line that says why; of very many the green are counted."""
    from rich.table import Table  # noqa: PLC0415 - start-up

    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(no_wrap=True)
    table.add_column(ratio=1, overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    rows = sheet.rows if len(sheet.rows) <= LISTED else [row for row in sheet.rows if not _plain(row)]
    for row in rows:
        table.add_row(_verdict(row), _details(sheet, row), _measured(row))
    if len(rows) < len(sheet.rows):
        more = number(len(sheet.rows) - len(rows), "more cell")
        table.add_row("", _styled((f"{more} of which there is nothing to say; the Markdown report lists them", GREY)))
    return table


def _plain(row: Row) -> bool:
    """Whether there is nothing to say of a cell: it works, as expected, or was not run."""
    return row.verdict in {Verdict.WORKS, Verdict.NOT_RUN} and row.as_expected is not False and not row.why


def _verdict(row: Row) -> Text:
    phase = (f"\n  in {row.phase}" if row.phase else "") + ("\n  repaired" if row.repaired else "")
    return _styled((f"{SYMBOLS[row.verdict]} {word(row.verdict)}", f"bold {_colour(row.verdict)}"), (phase, GREY))


def _details(sheet: Sheet, row: Row) -> Text:
    versions = ", ".join(f"{name} {version}" for name, version in zip(sheet.columns, row.versions, strict=True))
    where = f"\non {row.machine}" if len(sheet.machines) > 1 and row.verdict is not Verdict.NOT_RUN else ""
    parts = [(row.label, ""), (f"\n{versions}{where}", GREY)]
    if row.why:
        parts.append((f"\n{row.why}", "" if row.verdict is Verdict.WORKS else _colour(row.verdict)))
    parts += [(f"\nhid behind {mask}", GREY) for mask in row.hidden_by]
    parts += [(f"\nknown as {row.known}", ""), _told(row)] if row.known else []
    if row.expected:
        parts.append((f"\n{row.expected}", "bold" if row.as_expected is False else GREY))
    return _styled(*parts)


def _told(row: Row) -> tuple[str, str]:
    return f"\nremedy: {_first_sentence(row.remedy)}", GREEN if row.proven else ""


def _troubles(troubles: Iterable[Trouble]) -> Iterable[RenderableType]:
    """One line per cause, and what is known of it."""
    from rich.padding import Padding  # noqa: PLC0415 - start-up

    yield _styled(("by cause", "bold"))
    for one in troubles:
        head = (f"{_became(one)}: {one.where.replace('`', '')}", _colour(one.verdicts[0][0]))
        known = f"{one.known}: {one.cause}" if one.known else _cause_in_short(one)
        parts = [head, (f"\n{known}", "")]
        if one.remedy:
            proof = f" (proven {_proven(one)})" if one.proofs else " (not proven here)" if one.applicable else ""
            parts.append((f"\nremedy: {one.remedy}{proof}".replace("`", ""), GREEN if one.proofs else ""))
        parts += [(f"\n{link}", GREY) for link in one.references[:REFERENCES]]
        yield Padding(_styled(*parts), (0, 0, 0, INDENT))
    yield ""


def _measured(row: Row) -> Text:
    findings = f"\n{number(row.findings, 'finding')}" if row.findings else ""
    return _styled((f"{row.seconds:.1f} s" if row.verdict is not Verdict.NOT_RUN else "", ""), (findings, GREY))


def _attempts(attempts: Iterable[Attempt]) -> Iterable[RenderableType]:
    from rich.padding import Padding  # noqa: PLC0415 - start-up

    yield _styled(("changes tried, one at a time", "bold"))
    for tried in by_cell(attempts):
        yield Padding(_styled((tried[0].cell, ""), (f"\n{tried[0].before}", GREY)), (0, 0, 0, INDENT))
        for one in tried:
            told = f": {'; '.join(one.does)}{' (advice)' if one.advice else ''}\n{one.after}"
            head = (f"{one.effect}: {one.change}", EFFECTS.get(one.effect, YELLOW))
            yield Padding(_styled(head, (told, GREY)), (0, 0, 0, 2 * INDENT))
    yield ""


def by_cell(attempts: Iterable[Attempt]) -> list[list[Attempt]]:
    """The changes tried on one cell of one machine together, in their order."""
    found: dict[tuple[str, str], list[Attempt]] = {}
    for one in attempts:
        found.setdefault((one.cell, one.machine), []).append(one)
    return list(found.values())


def _remarks(title: str, remarks: Iterable[Remark]) -> Iterable[RenderableType]:
    from rich.padding import Padding  # noqa: PLC0415 - start-up

    yield _styled((title, "bold"))
    for remark in remarks:
        about = f" ({remark.about})" if remark.about else ""
        where = remark.cells[0] if len(remark.cells) == 1 else number(len(remark.cells), "cell")
        yield Padding(_styled((remark.text, ""), (f"{about}: {where}", GREY)), (0, 0, 0, INDENT))
    yield ""


def _styled(*parts: tuple[str, str]) -> Text:
    from rich.text import Text  # noqa: PLC0415 - start-up

    return Text.assemble(*parts, overflow="fold")


def _colour(verdict: Verdict) -> str:
    if verdict is Verdict.WORKS:
        return GREEN
    if verdict in UNTOLD:
        return GREY
    return YELLOW if verdict is Verdict.PARTIAL else RED

"""Write a report as Markdown. Nothing is computed here: `tables` has grouped everything that is shown."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from typing import Any

from harness.model import replace
from harness.model.report_types import SYMBOLS, first_few, format_count, word
from harness.reports.pictures import picture_markdown
from harness.reports.tables.table_types import Attempt, Pivot, Remark, Report, Sheet, Square
from harness.reports.template_files import fill
from harness.reports.text import cause_markdown, combination_markdown, family_markdown, frame_markdown, task_markdown
from harness.reports.text.markdown_texts import address, code, code_cell, file_link, prose, table_cell
from harness.standalone.control_characters import strip_controls

TEMPLATE = "report.md.j2"

NAMED = 3
"""Combinations left out, or tests, that are named where there are more."""

PLOT = re.compile(r"^!\\\[(sizes of the changes, release by release)\]\((behaviour-\d+\.svg)\)$", re.MULTILINE)
"""A plot that lies beside the report, after the escaping of pictures."""

RELEASE = re.compile(r"\d[\w.+]*")
"""The name of a row that is a release."""

NBSP = "\N{NO-BREAK SPACE}"


def markdown(report: Report, template: str) -> str:
    """Fill the template (the text of `templates/report.md.j2`) and return the page."""
    pictures = frame_markdown.Pictures()
    named = {**filters(), **_page_filters(report, pictures)}
    page = strip_controls(fill(template, named, report=report))
    page = page.replace("![", "!\\[")  # it shows no picture, wherever one came from
    return pictures.put_in(PLOT.sub(r"![\1](\2)", page))  # but for our own plots and frames


def _page_filters(report: Report, pictures: frame_markdown.Pictures) -> dict[str, Callable[..., Any]]:
    """Return the filters that need the whole page: its headings, and its pictures."""
    headings = cause_markdown.find_headings(report)
    return {
        "cause_heading": headings.title,
        "cause_index": lambda sheet: cause_markdown.cause_index(sheet.troubles, headings),
        "cause_also": lambda trouble, sheet: list(cause_markdown.also(trouble, headings, sheet.troubles)),
        "combination_tables": lambda sheet: combination_markdown.combination_tables(sheet, headings),
        "frame_tables": lambda rows: frame_markdown.frame_tables(rows, pictures.place),
    }


def filters() -> dict[str, Callable[..., Any]]:
    """Return the filters that templates apply to the values of a report."""
    return {
        "by_cell": by_cell,
        "cause_details": cause_markdown.details,
        "cause_fix": cause_markdown.fix,
        "cause_summary": cause_markdown.summary,
        "cause_unexpected": cause_markdown.unexpected,
        "cause_sources": cause_markdown.sources,
        "cause_where": cause_markdown.where,
        "cause_why": cause_markdown.why,
        "by_kind": _by_kind,
        "cell": table_cell,
        "changed": family_markdown.changed,
        "code_cell": lambda text: code_cell(combination_markdown.short(text)),
        "count_kinds": _count_kinds,
        "counts": _counts,
        "coverage": coverage,
        "family_legend": family_markdown.family_legend,
        "coverage_table": family_markdown.coverage_table,
        "family_table": family_markdown.family_table,
        "first_sentence": cause_markdown.first_sentence,
        "left_out": _left_out,
        "legend": legend,
        "named": lambda verdict: f"{SYMBOLS[verdict]} {word(verdict)}",
        "number": format_count,
        "picture_legend": picture_markdown.picture_legend,
        "picture_sentences": picture_markdown.picture_sentences,
        "picture_table": picture_markdown.picture_table,
        "picture_title": picture_markdown.picture_title,
        "result": result,
        "task_table": task_markdown.task_table,
        "pivot_table": pivot_table,
        "seen_in": lambda labels, cells: (
            cause_markdown.few(labels) if len(labels) < cells else f"all {format_count(cells, 'combination')}"
        ),
        "sentence": cause_markdown.sentence,
        "tests": _tests,
        "text": prose,
        "code": code,
        "file": lambda path: file_link(path, path),
        "address": address,
        "line": lambda text: " ".join(text.split("\n")),
        "results": results,
    }


# --- the small table -------------------------------------------------------------------------------------------


def small_table(pivot: Pivot) -> str:
    """Return the table over two axes as Markdown, its lines ended."""
    head = [f"{table_cell(pivot.down)} ╲ {table_cell(pivot.across)}", *map(table_cell, pivot.columns)]
    rows = [
        [table_cell(name), *(_square(pivot, square) for square in squares)]
        for name, squares in zip(pivot.rows, pivot.squares, strict=True)
    ]
    lines = [head, ["---", *(":-:" for _ in pivot.columns)], *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def pivot_table(pivot: Pivot) -> str:
    """Return the small table for a page: neighbouring releases that are alike are one row of a single column."""
    if len(pivot.columns) > 1 or not all(map(RELEASE.fullmatch, pivot.rows)):
        return small_table(pivot)
    starts = [
        place
        for place, squares in enumerate(pivot.squares)
        if not place or _squares(pivot, squares) != _squares(pivot, pivot.squares[place - 1])
    ]
    names = [
        pivot.rows[start] if end == start + 1 else f"{pivot.rows[start]} to {pivot.rows[end - 1]} ({end - start})"
        for start, end in pairwise([*starts, len(pivot.rows)])
    ]
    return small_table(replace(pivot, rows=tuple(names), squares=tuple(pivot.squares[start] for start in starts)))


def _squares(pivot: Pivot, squares: Iterable[Sequence[Square]]) -> list[str]:
    return [_square(pivot, square) for square in squares]


def _square(pivot: Pivot, square: Sequence[Square]) -> str:
    """Return `◐ 10/11` with the Pythons in small print below; a line for each verdict."""
    parts = []
    for entry in square:
        details = small(pivot, entry)
        # A browser must not break the line between a sign and its count.
        sign = table_cell(mark(pivot, entry)).replace(" ", NBSP)
        parts.append(sign + (f"<br><sub>{table_cell(details)}</sub>" if details else ""))
    return "<br>".join(parts)


def mark(pivot: Pivot, entry: Square) -> str:
    """Return the sign of a verdict with its extra marks, and how many of the tasks tried passed."""
    signs = SYMBOLS[entry.verdict] + "→✔" * entry.fixed + "?" * entry.doubted + "†" * entry.patched + "*" * entry.varies
    machines = pivot.machines
    place = f"{machines.index(entry.machine) + 1}: " if len(machines) > 1 else ""
    return f"{place}{signs}" + (f" {entry.passed}/{entry.tried}" if entry.tried else "")


def small(pivot: Pivot, entry: Square) -> str:
    """Return the small print of a square: Pythons if they differ, and the values that tell its verdicts apart."""
    hide_pythons = len(pivot.pythons) < 2 or "python" in {pivot.down, pivot.across}
    return "; ".join(
        filter(
            None,
            (
                "" if hide_pythons else ", ".join(entry.pythons),
                *entry.where,
                f"fails in {entry.phase}" if entry.phase else "",
            ),
        )
    )


def legend(pivot: Pivot) -> str:
    """Explain the signs of a small table that occur in it, in one paragraph."""
    return " ".join(_legend(pivot))


def _legend(pivot: Pivot) -> Iterator[str]:
    parts, machines, pythons = pivot.parts, pivot.machines, pivot.pythons
    shown = {one.verdict for one in parts}
    yield ", ".join(f"{sign} {word(verdict)}" for verdict, sign in SYMBOLS.items() if verdict in shown) + "."
    if any(one.tried for one in parts):
        uneven = any(one.uneven for one in parts)
        yield "`n/m`: n of m tasks passed" + ("; not every Python ran every task." if uneven else ".")
    if "python" not in {pivot.down, pivot.across} and pythons:
        yield f"All on Python {pythons[0]}." if len(pythons) == 1 else _python_words(parts)
    if any(not square for squares in pivot.squares for square in squares):
        yield "Empty: not tried."
    if any(one.fixed for one in parts):
        yield "→✔: works with a change that is listed below."
    if any(one.varies for one in parts):
        yield "`*`: fails under a side condition, listed below as variant."
    if any(one.patched for one in parts):
        yield "†: with patched metadata; the release as published cannot be installed."
    if any(one.doubted for one in parts):
        yield "✔?: raises no error, but a known silent defect was not excluded."
    if len(machines) > 1:
        yield f"Machines: {', '.join(f'{place} {name}' for place, name in enumerate(machines, 1))}."


def _python_words(parts: Iterable[Square]) -> str:
    several = any(len(one.pythons) > 1 for one in parts)
    return "Small: the Python versions tried." if several else "Small: the one Python version tried."


def coverage(report: Report) -> str:
    """Say when and where a report was measured, and which platforms it does not cover."""
    if not report.measured:
        return "Nothing was measured yet."
    first, last = report.measured
    days = f"on {first}" if first == last else f"from {first} to {last}"
    count = len(report.machines)
    where = "one machine" if count == 1 else f"{count} kinds of machine"
    missing = f" Not covered: {', '.join(report.uncovered)}." if report.uncovered else ""
    return f"Measured {days} on {where}: {'; '.join(report.platforms)}.{missing}"


# --- sentences -------------------------------------------------------------------------------------------------


def result(sheet: Sheet) -> str:
    """Say in a sentence how many combinations work, and whether anything is unexpected."""
    wrong = sum(row.as_expected is False for row in sheet.rows)
    if wrong:
        expected = f" {format_count(wrong, 'result')} {'is' if wrong == 1 else 'are'} not as expected."
    else:
        expected = " Every result is as expected." if any(row.as_expected for row in sheet.rows) else ""
    verb = "works" if sheet.works == 1 else "work"
    raises = "raises" if sheet.doubted == 1 else "raise"
    open_ = f" {sheet.doubted} more {raises} no error, but a known silent defect was not excluded." * bool(
        sheet.doubted
    )
    return f"{sheet.works} of {format_count(sheet.main, 'combination')} {verb}.{open_}{expected}"


def results(sheet: Sheet) -> str:
    """Return `6 combinations`, or `6 combinations, 11 results on 2 machines`."""
    cells, machines = format_count(sheet.cells, "combination"), len(sheet.machines)
    return (
        cells
        if machines == 1
        else f"{cells}, {format_count(sheet.results, 'result')} on {format_count(machines, 'machine')}"
    )


def _counts(sheet: Sheet) -> str:
    """Return `✔ 6 works, ✘ 2 broken (4 repairs among them); 3 combinations left out.`"""
    counts = ", ".join(f"{SYMBOLS[verdict]} {count} {word(verdict)}" for verdict, count in sheet.counts)
    roles = " and ".join(format_count(count, role) for role, count in sheet.roles)
    among = f" ({roles} among them)" if roles else ""
    return counts + among + (f"; {format_count(sheet.left_out, 'combination')} left out." if sheet.left_out else ".")


def by_cell(attempts: Iterable[Attempt]) -> list[list[Attempt]]:
    """Group the changes tried on one cell of one machine, in their order."""
    groups: dict[tuple[str, str], list[Attempt]] = {}
    for attempt in attempts:
        groups.setdefault((attempt.cell, attempt.machine), []).append(attempt)
    return list(groups.values())


def _by_kind(findings: Iterable[Remark]) -> list[tuple[str, list[Remark]]]:
    # groupby needs equal kinds side by side: `tables` sorts findings by kind first.
    return [(kind, list(held)) for kind, held in groupby(findings, key=lambda remark: remark.kind)]


def _count_kinds(findings: Sequence[Remark]) -> str:
    """Return `4 on reproducibility, 27 on API conformance`."""
    return ", ".join(
        f"{len(held)} on {kind}" if kind != "other" else f"{len(held)} other" for kind, held in _by_kind(findings)
    )


def _left_out(gone: Remark) -> str:
    """Return `3 combinations`, or the names if there are only a few."""
    # The counts differ where a pattern stands for many combinations, and then no list of names is complete.
    if gone.count == len(gone.cells) <= NAMED:
        return cause_markdown.codes(gone.cells)
    return format_count(gone.count, "combination")


def _tests(names: Sequence[str]) -> str:
    """Return the names of a few tests and the number of the others; a dash for none."""
    return first_few(list(map(code, names)), NAMED) or "-"


# --- Markdown --------------------------------------------------------------------------------------------------

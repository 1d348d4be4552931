"""Write a report as Markdown. Nothing is computed here: `tables` has grouped everything that is shown."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

from harness.model import Role, Verdict
from harness.model.report_types import SYMBOLS, UNTOLD, first_few, format_count, word
from harness.reports.pictures import picture_markdown
from harness.reports.tables.table_types import Attempt, Pivot, Remark, Report, Row, Sheet, Square, Task, Trouble
from harness.reports.template_files import fill
from harness.reports.text import family_markdown
from harness.reports.text.markdown_texts import ADDRESS, address, code, file_link, prose, table_cell
from harness.standalone.control_characters import strip_controls

TEMPLATE = "report.md.j2"

LONGEST_WHY = 200
"""Characters of a decisive line that a row shows; the section on its cause has all of it."""

NAMED, LISTED = 3, 6
"""Combinations that are named where there are more than a few, and how many are a few."""

PLOT = re.compile(r"^!\\\[(sizes of the changes, release by release)\]\((behaviour-\d+\.svg)\)$", re.MULTILINE)
"""A plot that lies beside the report, after the escaping of pictures."""

NBSP = "\N{NO-BREAK SPACE}"


def markdown(report: Report, template: str) -> str:
    """Fill the template (the text of `templates/report.md.j2`) and return the page."""
    page = strip_controls(fill(template, filters(), report=report))
    page = page.replace("![", "!\\[")  # it shows no picture, wherever one came from
    return PLOT.sub(r"![\1](\2)", page)  # but for our own plots


def filters() -> dict[str, Callable[..., Any]]:
    """Return the filters that templates apply to the values of a report."""
    return {
        "became": describe_results,
        "by_cell": by_cell,
        "by_kind": _by_kind,
        "cause": _cause,
        "cell": table_cell,
        "codes": _codes,
        "count_kinds": _count_kinds,
        "counts": _counts,
        "coverage": coverage,
        "files": _files,
        "family_legend": family_markdown.family_legend,
        "coverage_table": family_markdown.coverage_table,
        "family_table": family_markdown.family_table,
        "few": _few,
        "first_sentence": first_sentence,
        "left_out": _left_out,
        "legend": legend,
        "named": lambda verdict: f"{SYMBOLS[verdict]} {word(verdict)}",
        "number": format_count,
        "outcome": _outcome,
        "picture_legend": picture_markdown.picture_legend,
        "picture_sentences": picture_markdown.picture_sentences,
        "picture_table": picture_markdown.picture_table,
        "picture_title": picture_markdown.picture_title,
        "proven": proven,
        "reference": _reference,
        "result": result,
        "rule": lambda columns, mark: " | ".join(mark for _ in columns),
        "table": small_table,
        "task": _task,
        "tests": _tests,
        "text": prose,
        "code": code,
        "file": lambda path: file_link(path, path),
        "address": address,
        "line": lambda text: " ".join(text.split("\n")),
        "unknown": unknown,
        "results": results,
        "seen_in": lambda labels, cells: _few(labels) if len(labels) < cells else f"all {format_count(cells, 'cell')}",
        "sentence": lambda text: f"{text[:1].upper()}{text[1:].rstrip('.')}.",
        "short": _short,
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
        yield "✔?: raises nothing, but a known silent defect was not excluded."
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
    open_ = f" {sheet.doubted} more raise nothing, but a known silent defect was not excluded." * bool(sheet.doubted)
    return f"{sheet.works} of {format_count(sheet.main, 'combination')} {verb}.{open_}{expected}"


def results(sheet: Sheet) -> str:
    """Return `6 cells`, or `6 cells, 11 results on 2 machines`."""
    cells, machines = format_count(sheet.cells, "cell"), len(sheet.machines)
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


def describe_results(trouble: Trouble) -> str:
    """Return the results of the cells of a cause: `◐ 2 partial, ✘ broken in single`."""
    several = len(trouble.verdicts) > 1
    verdicts = ", ".join(
        f"{SYMBOLS[each]} {f'{count} ' if several else ''}{word(each)}" for each, count in trouble.verdicts
    )
    return verdicts + (f" in {', '.join(trouble.phases)}" if trouble.phases else "")


def _outcome(row: Row) -> str:
    """Return `◐ partial in render, repair (not expected)`."""
    phase = f" in {row.phase}" if row.phase else ""
    patched = ", patched" if row.repaired else ""
    role = f", {row.role}" if row.role is not Role.MAIN else ""
    unexpected = " (not expected)" if row.as_expected is False else ""
    return f"{SYMBOLS[row.verdict]} {word(row.verdict)}{phase}{patched}{role}{unexpected}"


def _cause(row: Row) -> str:
    """Return the known cause of a cell, linked to its details, and whether its fix is proven there."""
    if not row.known:
        return ""
    link = f"[`{row.known}`](#{row.known})" if re.fullmatch(r"[\w.-]+", row.known) else code(row.known)
    return f"{link}{', fix proven' if row.proven else ''}"


def unknown(trouble: Trouble) -> str:
    """Return the words for a cause where no known failure fits."""
    verdict = trouble.verdicts[0][0]
    return "it works" if verdict is Verdict.WORKS else word(verdict) if verdict in UNTOLD else "not known"


def first_sentence(text: str) -> str:
    """Return the text up to the first full stop that ends a sentence."""
    match = re.match(r".*?[^.][.](?= [A-Z`(]|$)", text)
    return (match[0] if match else text).removesuffix(".")


def proven(trouble: Trouble) -> str:
    """Say which cell proves a fix, and for how many cells if not for all; or that nobody tried it."""
    if trouble.proofs:
        return f"proven by {code(trouble.proofs[0][0])}" + (
            f", for {trouble.proven} of {trouble.cells}" if trouble.proven < trouble.cells else ""
        )
    if trouble.neighbour:
        return f"proven by a neighbour: {code(trouble.neighbour)} works and differs only in this"
    if trouble.together:
        return f"not tried alone; {code(trouble.together)} works with this and more"
    return "not tried" if trouble.applicable else ""


def _reference(link: str) -> str:
    """Return a link with a text as short as it can be: `owner/name#12`, else its host."""
    match = re.match(r"https?://(?:www\.)?([^/]+)(?:/([^/]+/[^/]+)/(?:issues|pull|discussions)/(\d+))?", link)
    text = (f"{match[2]}#{match[3]}" if match[3] else match[1]) if match else link
    return f"[{text}]({link})" if ADDRESS.fullmatch(link) else code(link)


def _task(task: Task) -> str:
    """Return the name of a task, with its environment if that has another name."""
    if not task.env:
        return f"import of {code(task.name)}"
    return code(task.name) if task.env == task.name else f"{code(task.name)} ({code(task.env)})"


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
        return _codes(gone.cells)
    return format_count(gone.count, "combination")


def _files(row: Row) -> str:
    """Return links to the lock of a cell and to a picture of each task."""
    links = [("lock", row.lock)] if row.lock else []
    return ", ".join(file_link(name, path) for name, path in [*links, *row.frames])


def _tests(names: Sequence[str]) -> str:
    """Return the names of a few tests and the number of the others; a dash for none."""
    return first_few(list(map(code, names)), NAMED) or "-"


# --- Markdown --------------------------------------------------------------------------------------------------


def _codes(labels: Iterable[str]) -> str:
    return ", ".join(" on ".join(map(code, label.split(" on "))) for label in labels)


def _few(labels: Sequence[str]) -> str:
    """Return a few names as code; of more than `LISTED` names, the first ones and the number of the others."""
    if len(labels) <= LISTED:
        return _codes(labels)
    return f"{_codes(labels[:NAMED])} and {len(labels) - NAMED} more"


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_WHY else f"{line[: LONGEST_WHY - 1].rstrip()}…"

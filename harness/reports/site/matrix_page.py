"""Write the page of a matrix: its table over two axes, every combination, what changes, and data for the filters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import urlencode

from harness.model import Role
from harness.model.report_types import SYMBOLS, CellEntry, word
from harness.reports.site import addresses
from harness.reports.site.evidence_files import EvidenceFiles
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import DOUBTED, CellLink, SiteFacts, mark_of, name_mark, sign
from harness.reports.site.site_sources import Source
from harness.reports.tables.table_types import Pivot, Row, Sheet
from harness.reports.text import cause_markdown, report_markdown

NOTHING = "-"

MOST_ROWS, MOST_SQUARES = 500, 600
"""Rows of the list and squares of the table that the page of a matrix holds; larger ones have pages of their own."""


def write(facts: SiteFacts, writer: PageWriter, files: EvidenceFiles) -> None:
    """Write a page for each matrix."""
    for name, (source, sheet) in facts.sheets.items():
        address = addresses.matrix_page(name)
        cells = [cell for cell in source.document.cells if cell.matrix == name]
        rows = [(row, facts.cell_link(row.id), facts.issue_address(row.known)) for row in sheet.rows]
        pivot = _pivot(facts, sheet.pivot, cells) if sheet.pivot else None
        legend = report_markdown.legend(sheet.pivot) if sheet.pivot else ""
        writer.write_data(address.replace("index.html", "data.js"), "MATRIX", _data(facts, sheet, cells))
        writer.write(
            address,
            "matrix.html.j2",
            matrix=name,
            sheet=sheet,
            result=report_markdown.result(sheet),
            coverage=report_markdown.coverage(source.report),
            pivot=pivot,
            legend=legend,
            rows=rows,
            parts=_write_parts(name, sheet, rows, writer),
            most_rows=MOST_ROWS,
            most_squares=MOST_SQUARES,
            troubles=[(one, facts.issue_address(one.known)) for one in sheet.troubles],
            became=cause_markdown.describe_results,
            proven=cause_markdown.proven,
            plots=_plots(source, sheet, files),
            environment_address=facts.environment_address,
            environment_links=facts.environment_links,
            whole=source.folder is not None,
        )
        if pivot and len(pivot["rows"]) * len(pivot["columns"]) > MOST_SQUARES:
            writer.write(address.replace("index.html", "table.html"), "matrix_part.html.j2", matrix=name,
                         words=f"{pivot['down']} by {pivot['across']}", pivot=pivot, legend=legend)  # fmt: skip


def _write_parts(
    matrix: str, sheet: Sheet, rows: Sequence[tuple[Row, CellLink, str]], writer: PageWriter
) -> list[tuple[str, str]]:
    """Write a list of many rows as pages, which are read without scripts; return the file and the words of each."""
    parts = []
    for start in range(MOST_ROWS, len(rows), MOST_ROWS):
        held = rows[start : start + MOST_ROWS]
        file, words = f"list-{start // MOST_ROWS + 1}.html", f"combinations {start + 1} to {start + len(held)}"
        writer.write(addresses.matrix_page(matrix).replace("index.html", file), "matrix_part.html.j2", matrix=matrix,
                     words=words, pivot=None, legend="", rows=held, columns=sheet.columns)  # fmt: skip
        parts.append((file, words))
    return parts


def _plots(source: Source, sheet: Sheet, files: EvidenceFiles) -> dict[str, Any]:
    return {table.picture: files.plot(source, table) for table in sheet.families}


def _pivot(facts: SiteFacts, pivot: Pivot, cells: list[CellEntry]) -> dict[str, Any]:
    """Return the small table: for each square the marks of its verdicts, each with a link to its cell or to a list."""
    met: dict[tuple[str, str, str, str], list[str]] = {}
    for cell in cells:
        if cell.role is Role.MAIN and cell.measured:
            place = cell.axes.get(pivot.down, NOTHING), cell.axes.get(pivot.across, NOTHING)
            met.setdefault((*place, cell.machine or NOTHING, cell.verdict), []).append(cell.id)
    rows = []
    for row, squares in zip(pivot.rows, pivot.squares, strict=True):
        line = []
        for column, square in zip(pivot.columns, squares, strict=True):
            parts = []
            for part in square:
                ids = met.get((row, column, part.machine, part.verdict), [])
                parts.append(
                    {
                        "verdict": part.verdict,
                        "mark": report_markdown.mark(pivot, part),
                        "small": report_markdown.small(pivot, part),
                        "word": word(part.verdict),
                        "count": len(ids),
                        "link": facts.cell_link(ids[0]).address if len(ids) == 1 else "",
                        "query": urlencode({f"axis.{pivot.down}": row, f"axis.{pivot.across}": column}),
                    }
                )
            line.append(parts)
        rows.append((row, line))
    return {"down": pivot.down, "across": pivot.across, "columns": pivot.columns, "rows": rows}


def _data(facts: SiteFacts, sheet: Sheet, cells: list[CellEntry]) -> dict[str, Any]:
    """Return the data of the filters: an entry for each row of the list, in the same order; each text is there once."""
    entries = {cell.id: cell for cell in cells}
    first = (sheet.pivot.down, sheet.pivot.across) if sheet.pivot else ()
    axes = list(dict.fromkeys((*first, *(name for cell in cells for name in sorted(cell.axes)))))
    texts: dict[str, int] = {}
    return {
        "axes": axes,
        "pivot": [*first] or [*axes, *axes][:2],
        "signs": {mark: sign(mark) for mark in (*SYMBOLS, DOUBTED)},
        "words": {mark: name_mark(mark) for mark in (*SYMBOLS, DOUBTED)},
        "issues": {row.known: facts.issue_address(row.known) for row in sheet.rows if row.known},
        "cells": [_cell(facts, row, entries[row.id], axes, texts) for row in sheet.rows],
        "texts": list(texts),
    }


def _cell(facts: SiteFacts, row: Row, entry: CellEntry, axes: list[str], texts: dict[str, int]) -> dict[str, Any]:
    """Return the entry of a row. `why` and `more`, which the search looks through, are places in `texts`."""
    families = [f"{case.env or case.case}: {case.behaviour.family}" for case in entry.cases if case.behaviour]
    more = filter(None, (row.cause, " ".join(case.env or "" for case in entry.cases).strip()))
    return {
        "label": row.label,
        "link": facts.cell_link(row.id).address,
        "verdict": mark_of(entry),
        "phase": row.phase,
        "expected": row.as_expected,
        "why": texts.setdefault(row.why, len(texts)),
        "cause": row.known,
        "tasks": f"{row.passed}/{row.tried}" if row.tried else "",
        "versions": row.versions,
        "family": families,
        "axes": [entry.axes.get(axis, NOTHING) for axis in axes],
        "more": [texts.setdefault(text, len(texts)) for text in more],
    }

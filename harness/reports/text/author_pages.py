"""Render a page that a matrix's author wrote: a template in words, with every figure from the report document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from harness.devices import egl_advice, egl_rules
from harness.model import cellid
from harness.model.errors import BadInput
from harness.model.report_types import CaseEntry, CellEntry, Document
from harness.reports.tables import cause_groups, change_effects
from harness.reports.tables.table_types import Report
from harness.reports.text import camera_pages, report_markdown


def render(template: str, document: Document, report: Report) -> str:
    """Fill a template with `document`, `report` and functions that find cells. Raises BadInput for a wrong template.

    `cell("LABEL")` is the cell of this label. `cells(AXIS="VALUE", ...)` are the unchanged cells with these values (a
    list means any of them). `case(CELL, "ID")` is one of its cases. `effect("LABEL_with-NAME")` is the effect of a
    change, `changed("LABEL", "NAME")` the cell that a change of this name makes of that cell. `CELL | camera_pairs` are
    the results of its cameras. `rendering` and `advising` have the rules by which devices are chosen. `VERSIONS |
    in_order` sorts versions by age.
    """
    from jinja2 import StrictUndefined, TemplateError  # noqa: PLC0415 - start-up
    from jinja2.sandbox import SandboxedEnvironment  # noqa: PLC0415

    # A page comes with its matrix, which may be somebody else's.
    environment = SandboxedEnvironment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters |= {
        **report_markdown.filters(),
        "camera_pairs": camera_pages.pairs,
        "in_order": cause_groups.in_order,
    }
    lookup = _Cells(document.cells)
    context: dict[str, Any] = {"rendering": egl_rules, "advising": egl_advice}
    context |= {
        "cell": lookup.find_cell,
        "cells": lookup.having,
        "case": _case,
        "effect": lookup.effect,
        "changed": lookup.changed,
    }
    try:
        return environment.from_string(template).render(document=document, report=report, **context)
    except TemplateError as error:
        line = getattr(error, "lineno", None)
        message = (
            f"the page of {', '.join(document.matrices)}: {f'line {line}: ' if line else ''}{error.message or error}"
        )
        raise BadInput(message) from None


class _Cells:
    """The cells of a document; of a cell measured on several machines, the latest measurement."""

    def __init__(self, cells: Sequence[CellEntry]) -> None:
        latest: dict[str, CellEntry] = {}
        for cell in cells:
            previous = latest.setdefault(cell.id, cell)
            latest[cell.id] = max(previous, cell, key=lambda entry: entry.measured or "")
        self.cells = tuple(latest.values())

    def find_cell(self, label: str) -> CellEntry:
        entry = next((cell for cell in self.cells if cellid.has_name(label, cell)), None)
        if entry is None:
            message = f'its page speaks of a cell "{label}", which the matrix does not have'
            raise BadInput(message)
        return entry

    def changed(self, label: str, name: str) -> CellEntry:
        base = self.find_cell(label)
        candidates = (cell for cell in self.cells if cell.base == base.id and cell.change and cell.change.name == name)
        entry = next(candidates, None)
        if entry is None:
            message = f'its page speaks of a change "{name}" of "{label}", which the matrix does not have'
            raise BadInput(message)
        return entry

    def having(self, **axes: Any) -> tuple[CellEntry, ...]:
        # A keyword cannot hold the hyphen of a package's name; `_value` finds axes that really have `_`.
        wanted = {name.replace("_", "-"): (value,) if isinstance(value, str) else value for name, value in axes.items()}
        planned = (cell for cell in self.cells if cell.base is None)
        return tuple(cell for cell in planned if all(_value(cell, name) in wanted[name] for name in wanted))

    def effect(self, label: str) -> str:
        after = self.find_cell(label)
        before = next((cell for cell in self.cells if cell.id == after.base), None)
        if before is None:
            message = f'its page asks what the change of "{label}" did, which is no changed cell'
            raise BadInput(message)
        return change_effects.effect(before, after)


def _value(cell: CellEntry, axis: str) -> str | None:
    return cell.axes.get(axis, cell.axes.get(axis.replace("-", "_")))


def _case(cell: CellEntry, name: str) -> CaseEntry:
    entry = next((case for case in cell.cases if case.case == name), None)
    if entry is None:
        message = f'its page speaks of a case "{name}", which {cell.id} does not have'
        raise BadInput(message)
    return entry

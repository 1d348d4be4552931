"""Hold all that pages are written from: reports, measured results, known issues, and which pages there are."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from msgspec.structs import replace
from packaging.utils import canonicalize_name

from harness.judging import known_issues
from harness.judging.known_issues import Issue
from harness.matrix.signatures import Signature
from harness.model import Verdict
from harness.model.measured import Measured
from harness.model.report_types import SYMBOLS, CellEntry, word
from harness.model.vocabulary import required_name
from harness.reports.answers import measured_cells
from harness.reports.answers.measured_cells import CellResult
from harness.reports.site import addresses
from harness.reports.site.site_sources import Source
from harness.reports.tables.table_types import Row, Sheet
from harness.standalone.versions import is_version

LATER = re.compile(r"v\d+")
"""A further version of an environment in a row of families."""

DOUBTED = "doubted"
"""Beside the verdicts: the combination works, but a known silent defect was not excluded."""

NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?")


@dataclass(frozen=True, kw_only=True, slots=True)
class CellLink:
    """A cell as other pages show it; `address` is empty if the site has no page of it.

    A cell that works is `doubted` if a known silent defect was not excluded.
    """

    id: str
    label: str
    matrix: str
    verdict: Verdict
    address: str
    doubted: bool = False

    @property
    def word(self) -> str:
        """Return the verdict in readable words."""
        return name_mark(DOUBTED) if self.doubted else word(self.verdict)


@dataclass(frozen=True, kw_only=True)
class SiteFacts:
    """All that the pages of a site are written from. `issues` are without the cells that have them."""

    sources: tuple[Source, ...]
    measured: Measured
    signatures: Mapping[str, Signature]
    issues: tuple[Issue, ...]

    @cached_property
    def entries(self) -> dict[str, list[tuple[Source, CellEntry]]]:
        """Return the results of each cell, with the report that has them."""
        entries: dict[str, list[tuple[Source, CellEntry]]] = {}
        for source in self.sources:
            for cell in source.document.cells:
                entries.setdefault(cell.id, []).append((source, cell))
        return entries

    @cached_property
    def sheets(self) -> dict[str, tuple[Source, Sheet]]:
        """Return the tables of each matrix, with the report that has them."""
        return {sheet.matrix: (source, sheet) for source in self.sources for sheet in source.report.sheets}

    @cached_property
    def rows(self) -> dict[str, Row]:
        """Return the row of each cell in the list of its matrix."""
        return {row.id: row for _, sheet in self.sheets.values() for row in sheet.rows}

    @cached_property
    def cells(self) -> list[CellResult]:
        """Return the measured cells that can be compared, each with the versions in its lock.

        A report of others may hold names and versions that are none: its cells have their pages, and count no further.
        """
        sound = tuple(one.cell for one in measured_cells.read(self.measured) if _is_sound(one))
        return measured_cells.read(replace(self.measured, cells=sound))

    @cached_property
    def results(self) -> dict[tuple[str, str | None], CellResult]:
        """Return the measured cells by id and machine."""
        return {(one.cell.id, one.cell.machine): one for one in self.cells}

    @cached_property
    def issues_with_cells(self) -> dict[str, Issue]:
        """Return the known issues by id, with the cells that have them."""
        return {one.id: one for one in known_issues.with_cells(self.issues, self.measured.cells)}

    @cached_property
    def packages(self) -> list[str]:
        """Return the packages that have a page: those that a case ran, or that a matrix names and a lock has."""
        return sorted({name for one in self.cells for name in one.exercised | (one.named & one.pins.keys())})

    @cached_property
    def environments(self) -> list[str]:
        """Return the environment ids that were tried."""
        return sorted({case.env for one in self.cells for case in one.cell.cases if case.env})

    @cached_property
    def generated(self) -> str:
        """Return the day of the newest report."""
        return max(source.document.generated for source in self.sources)[:10]

    def cell_link(self, cell_id: str) -> CellLink:
        """Return a cell as other pages show it."""
        held = self.entries.get(cell_id)
        if not held:
            cell = next((one.cell for one in self.cells if one.cell.id == cell_id), None)
            verdict = cell.verdict if cell else Verdict.NOT_RUN
            return CellLink(id=cell_id, label=cell_id, matrix="", verdict=verdict, address="")
        entry = held[0][1]
        address = addresses.cell_page(cell_id, entry.matrix)
        doubted = mark_of(entry) == DOUBTED
        return CellLink(id=cell_id, label=entry.label, matrix=entry.matrix, verdict=entry.verdict, address=address,
                        doubted=doubted)  # fmt: skip

    def cell_links(self, ids: Iterable[str]) -> list[CellLink]:
        """Return cells as other pages show them, each once."""
        return [self.cell_link(name) for name in dict.fromkeys(ids)]

    def issue_address(self, name: str) -> str:
        """Return the address of the page of a known issue; empty if there is none."""
        issue = known_issues.lookup(name, self.issues)
        return addresses.issue_page(issue.id) if issue else ""

    def package_address(self, name: str) -> str:
        """Return the address of a package's page; empty if there is none."""
        return addresses.package_page(name) if name in set(self.packages) else ""

    def environment_address(self, name: str | None) -> str:
        """Return the address of the page of an environment id; empty if there is none."""
        return addresses.environment_page(name) if name and name in set(self.environments) else ""

    def environment_links(self, names: str) -> list[tuple[str, str, str]]:
        """Return the environments of a row of families as text, id and address: `Ant-v4, v5` has two."""
        first, *others = names.split(", ")
        stem = first.rpartition("-")[0]
        if not all(map(LATER.fullmatch, others)):
            first, others = names, []
        ids = [(first, first), *((other, f"{stem}-{other}") for other in others)]
        return [(text, name, self.environment_address(name)) for text, name in ids]

    def issues_of(self, package: str) -> Sequence[Issue]:
        """Return the known issues in which a package takes part."""
        issues = self.issues_with_cells.values()
        return [one for one in issues if package in set(map(required_name, one.packages))]


def mark_of(entry: CellEntry) -> str:
    """Return the verdict of a cell, or `doubted` if it works and a known silent defect was not excluded."""
    return DOUBTED if entry.verdict is Verdict.WORKS and entry.doubts else str(entry.verdict)


def sign(mark: str) -> str:
    """Return the sign of a verdict or of `doubted`."""
    return "✔?" if mark == DOUBTED else SYMBOLS[Verdict(mark)]


def name_mark(mark: str) -> str:
    """Return the readable words of a verdict or of `doubted`."""
    return "works, in doubt" if mark == DOUBTED else word(mark)


def _is_sound(result: CellResult) -> bool:
    """Return whether every package of a cell has a name and a version, and its requirements can be read."""
    try:
        names = {*result.versions, *result.named, *(canonicalize_name(one.name) for one in result.requirements)}
    except ValueError:
        return False
    versions = [*result.versions.values(), *([result.python] if result.python else [])]
    return all(map(NAME.fullmatch, names)) and all(map(is_version, versions))

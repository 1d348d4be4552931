"""Write the home page: what works together today, the figure of the table itself, and what the search looks through."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from packaging.version import Version

from harness.model import Verdict
from harness.reports.answers import measured_cells
from harness.reports.install_texts import install_commands
from harness.reports.site import addresses, issue_page, package_page
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import DOUBTED, SiteFacts, mark_of

TOGETHER = 18
"""Rows of the first table."""

SIGNS: dict[str, str] = {
    Verdict.NOT_RUN: "The combination was not tried.",
    Verdict.INCONCLUSIVE: "The machine or the network failed, so the packages were not judged.",
    Verdict.UNAVAILABLE: "The machine lacks something, for example a GPU or a Python version.",
    Verdict.UNRESOLVABLE: "The requirements exclude each other.",
    Verdict.UNINSTALLABLE: "A package cannot be built or installed.",
    Verdict.IMPORT_FAILS: "A module cannot be imported.",
    Verdict.MISLEADS: "Nothing is raised, but a check shows a wrong result: for example, a camera looks elsewhere.",
    DOUBTED: "Nothing failed, but a known silent defect was not excluded.",
    Verdict.WORKS: "Every environment passed every check.",
    Verdict.PARTIAL: "Some environments or phases passed, and others failed.",
    Verdict.BROKEN: "The import passed, and every environment failed after it.",
}
"""The meaning of each verdict, in the order in which verdicts are decided."""


def write(facts: SiteFacts, writer: PageWriter) -> None:
    """Write the home page and the data of its boxes."""
    writer.write_data("assets/search.js", "SEARCH", list(_search(facts)))
    writer.write_data("assets/issues.js", "ISSUES", issue_page.data(facts.signatures))
    heavy = Counter(name for one in facts.cells for name in one.exercised if measured_cells.is_heavy(name))
    counts = sum((_marks(facts, name) for name in facts.sheets), Counter[str]())
    writer.write(
        "index.html",
        "home.html.j2",
        together=list(_together(facts)),
        families=[_family(facts, name) for name, _ in heavy.most_common()],
        matrices=[_matrix(facts, name) for name in facts.sheets],
        counts=counts,
        total=counts.total(),
        signs=SIGNS.items(),
        verdicts=[mark for mark, _ in counts.most_common()],
        coverage=_coverage(facts),
        packages=[(name, addresses.package_page(name)) for name in facts.packages],
        environments=[(name, addresses.environment_page(name)) for name in facts.environments],
        issues=sorted(
            (issue_page.title(facts.signatures[name]), addresses.issue_page(name), name) for name in facts.signatures
        ),
    )


def _marks(facts: SiteFacts, matrix: str) -> Counter[str]:
    """Count the rows of a matrix by verdict; those that work and are doubted count apart."""
    source, sheet = facts.sheets[matrix]
    entries = {cell.id: cell for cell in source.document.cells if cell.matrix == matrix}
    return Counter(mark_of(entries[row.id]) for row in sheet.rows)


def _matrix(facts: SiteFacts, name: str) -> dict[str, Any]:
    """Return a matrix with how many of its combinations have each verdict, as its own page counts them."""
    source, sheet = facts.sheets[name]
    days = sorted({cell.measured[:10] for cell in source.document.cells if cell.matrix == name and cell.measured})
    return {
        "name": name,
        "title": sheet.title,
        "address": addresses.matrix_page(name),
        "counts": _marks(facts, name),
        "days": list(dict.fromkeys([days[0], days[-1]])) if days else [],
        "kept": source.folder is not None,
    }


def _coverage(facts: SiteFacts) -> str:
    """Say where everything was measured, and which platforms are not covered."""
    reports = [source.report for source in facts.sources if source.report.measured and source.folder]
    days = sorted(day for report in reports for day in report.measured or ())
    if not days:
        return "Nothing was measured yet."
    platforms = dict.fromkeys(name for report in reports for name in report.platforms)
    missing = set.intersection(*(set(report.uncovered) for report in reports))
    where = f"Measured from {days[0]} to {days[-1]}: {'; '.join(platforms)}."
    return where + (f" Not covered: {', '.join(sorted(missing))}." if missing else "")


def _together(facts: SiteFacts) -> Iterator[dict[str, Any]]:
    """Yield the newest combination that works of the packages that most cells are about together."""
    groups: Counter[tuple[str, ...]] = Counter()
    for result in facts.cells:
        names = tuple(sorted(name for name in result.subjects if measured_cells.is_heavy(name)))
        if result.works and names:
            groups[names] += 1
    rows = 0
    for names, count in groups.most_common():
        best = package_page.newest(facts, names)
        if best and rows < TOGETHER:
            rows += 1
            yield {
                "packages": [(name, best.versions[name], facts.package_address(name)) for name in names],
                "pythons": [".".join(python.split(".")[:2]) for python in best.pythons],
                "install": install_commands.command(best),
                "measured": best.measured[:10],
                "cells": count,
                "cell": facts.cell_link(best.cell),
            }


def _family(facts: SiteFacts, name: str) -> dict[str, Any]:
    """Return how many releases of a package are measured, inferred and unknown, with dates."""
    measured = package_page.releases(facts, name)
    every = package_page.published(name)
    guessed = package_page.inferred(facts, name, measured, every)
    there = {package_page.release_of(one.version) for one in measured}
    works = sum(one.works for one in measured)
    days = sorted(one.measured for one in measured)
    address = facts.package_address(name)
    return {
        "name": name,
        "address": address,
        "releases": address and f"{address}#releases",
        "unmeasured": address and f"{address}#unmeasured",
        "works": works,
        "fails": len(measured) - works,
        "inferred": len(guessed),
        "published": len(every),
        "unknown": sum(Version(one) not in there for one in every) - len(guessed) if every else None,
        "newest": max(every, key=Version) if every else "",
        "newest_day": every[max(every, key=Version)] if every else "",
        "measured_to": measured[-1].version,
        "days": (days[0], days[-1]),
    }


def _search(facts: SiteFacts) -> Iterator[Sequence[str]]:
    """Yield kind, name, address and further words of everything that the search finds."""
    for name in facts.packages:
        yield "package", name, addresses.package_page(name), ""
    for name in facts.environments:
        yield "environment", name, addresses.environment_page(name), ""
    for name, issue in facts.issues_with_cells.items():
        text = issue_page.search_text(issue)
        yield "known issue", issue_page.title(facts.signatures[name]), addresses.issue_page(name), text
    for name in facts.sheets:
        yield "matrix", name, addresses.matrix_page(name), ""
    for name, held in facts.entries.items():
        yield "combination", name, facts.cell_link(name).address, held[0][1].decisive or ""

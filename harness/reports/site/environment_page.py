"""Write the page of an environment id: where it works, with which releases its behaviour changes, and a badge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import groupby
from typing import Any

from packaging.version import Version

from harness.model.measured import ReleaseSeries
from harness.reports.answers.measured_cells import CellResult, case_works
from harness.reports.site import addresses, package_page
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts


def write(facts: SiteFacts, writer: PageWriter) -> None:
    """Write a page and a badge for each environment id."""
    tried: dict[str, list[tuple[CellResult, bool]]] = {}
    apis: dict[str, set[str]] = {}
    for result in facts.cells:
        for case in result.cell.cases:
            if case.env:
                tried.setdefault(case.env, []).append((result, case_works(case)))
                apis.setdefault(case.env, set()).add(case.api)
    for name in facts.environments:
        held = tried[name]
        works = [one for one, good in held if good]
        address = addresses.environment_page(name)
        cells = sorted(((facts.cell_link(one.cell.id), good) for one, good in held), key=lambda pair: pair[1])
        count = len(works)
        writer.write(
            address,
            "environment.html.j2",
            name=name,
            apis=sorted(apis[name]),
            cells=cells,
            works=count,
            packages=list(_packages(facts, held)),
            series=[_series(one) for one in facts.measured.series if one.env == name],
            measured=max(one.cell.measured for one, _ in held)[:10],
        )
        package_page.badge(writer, address, name, f"works in {count} of {len(held)}", works=count > 0)


def _packages(facts: SiteFacts, held: list[tuple[CellResult, bool]]) -> Iterator[dict[str, Any]]:
    """Yield the packages that its cells are about, with the releases with which it works, and those with which not."""
    counts = Counter(name for one, _ in held for name in one.subjects)
    for name, _ in counts.most_common():
        good = {str(one.version(name)) for one, works in held if works and name in one.subjects}
        bad = {str(one.version(name)) for one, works in held if not works and name in one.subjects} - good
        yield {
            "name": name,
            "address": facts.package_address(name),
            "works": sorted(good, key=Version),
            "fails": sorted(bad, key=Version),
        }


def _series(series: ReleaseSeries) -> dict[str, Any]:
    """Return a series as ranges of neighbouring releases that behave alike."""
    pairs = zip(series.releases, series.families, strict=True)
    ranges = [(letter, [release for release, _ in group]) for letter, group in groupby(pairs, key=lambda pair: pair[1])]
    return {
        "series": series,
        "where": ", ".join(f"{name} {version}" for name, version in series.where.items()),
        "ranges": [(letter, package_page.span(names)) for letter, names in ranges],
        "matrix": addresses.matrix_page(series.matrix),
    }

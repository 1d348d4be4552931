"""Write the page of an environment id: where it works, with which releases its behaviour changes, and a badge."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from harness.model import Outcome
from harness.model.measured import ReleaseSeries
from harness.model.report_types import CaseEntry
from harness.model.vocabulary import CHANGING
from harness.reports.answers import recommending
from harness.reports.answers.measured_cells import CellResult, Query, Wanted, case_works, is_heavy
from harness.reports.install_texts import install_commands
from harness.reports.site import addresses, package_page
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts

MOST_TRAPS = 12
STEM = re.compile(r"-v\d+$")
FAILURES = {Outcome.FAILED, Outcome.CRASHED, Outcome.TIMED_OUT, Outcome.FLAKY}

Tried = list[tuple[CellResult, CaseEntry]]


def write(facts: SiteFacts, writer: PageWriter) -> None:
    """Write a page and a badge for each environment id."""
    tried: dict[str, Tried] = {}
    for result in facts.cells:
        for case in result.cell.cases:
            if case.env:
                tried.setdefault(case.env, []).append((result, case))
    for name in facts.environments:
        held = tried[name]
        works = [one for one, case in held if case_works(case)]
        fails = [one for one, case in held if not case_works(case)]
        address = addresses.environment_page(name)
        writer.write(
            address,
            "environment.html.j2",
            name=name,
            apis=sorted({case.api for _, case in held}),
            good=facts.cell_links(one.cell.id for one in works),
            bad=facts.cell_links(one.cell.id for one in fails),
            packages=list(_packages(facts, held)),
            last_good=[(best, install_commands.command(best)) for best in _last_good(held)],
            traps=list(_traps(facts, held))[:MOST_TRAPS],
            series=[_series(one) for one in facts.measured.series if one.env == name],
            measured=max(one.cell.measured for one, _ in held)[:10],
            cell_link=facts.cell_link,
            alike=[(other, facts.environment_address(other)) for other in _alike(name, facts.environments)],
        )
        text = f"works in {len(works)} of {len(held)}"
        package_page.badge(writer, address, name, text, works=bool(works))


def _last_good(held: Tried) -> Iterator[recommending.Combination]:
    """Yield for each API the newest combination in which an environment passes and all else works."""
    for api in sorted({case.api for _, case in held}):
        works = [one for one, case in held if case.api == api and case_works(case)]
        heavy = Counter(name for one in works for name in one.subjects if is_heavy(name) and name in one.exercised)
        every = (
            recommending.combinations(works, Query(wanted=(Wanted.of(name),)), 1) for name, _ in heavy.most_common()
        )
        yield from next(filter(None, every), [])


def _packages(facts: SiteFacts, held: Tried) -> Iterator[dict[str, Any]]:
    """Yield the packages that its cells are about, with the releases with which it works, and the newest streak."""
    counts = Counter(name for one, _ in held for name in one.subjects if one.version(name))
    good = {id(one) for one, case in held if case_works(case)}

    def works(result: CellResult) -> bool:
        return id(result) in good

    for name, _ in counts.most_common():
        releases = package_page.group_releases((one for one, _ in held if name in one.subjects), name, works)
        ranges = [(key, [one.version for one in group]) for key, group in groupby(releases, lambda one: one.works)]
        yield {
            "name": name,
            "address": facts.package_address(name),
            "works": [package_page.span(versions) for key, versions in ranges if key],
            "fails": [package_page.span(versions) for key, versions in ranges if not key],
            "streak": package_page.streak(releases, works) if len(releases) > 1 else None,
        }


def _traps(facts: SiteFacts, held: Tried) -> Iterator[dict[str, Any]]:
    """Yield why it does not pass, the reason of most cells first: known issues, else the line that decides."""
    groups: dict[str, Tried] = {}
    for result, case in held:
        if not case_works(case):
            names = [*result.cell.causes, *(name.removeprefix("silent:") for name in case.unverified)]
            issue = next(filter(facts.issue_address, names), "")
            line = CHANGING.sub("…", case.decisive or result.cell.decisive or "")
            groups.setdefault(issue or line, []).append((result, case))
    for key, group in sorted(groups.items(), key=lambda pair: -len(pair[1])):
        result, case = group[0]
        expected = result.cell.expectation
        yield {
            "issue": facts.issues_with_cells.get(key),
            "address": facts.issue_address(key),
            "line": case.decisive or result.cell.decisive or "",
            "reason": expected.reason if expected else "",
            "phases": [phase for phase, outcome in case.phases.items() if outcome in FAILURES],
            "cells": facts.cell_links(one.cell.id for one, _ in group),
        }


def _alike(name: str, every: Sequence[str]) -> list[str]:
    """Return other versions of an environment, and others of its namespace."""
    stem = STEM.sub("", name)
    versions = [other for other in every if other != name and STEM.sub("", other) == stem]
    space = name.partition("/")[0] if "/" in name else ""
    return versions + [other for other in every if space and other.startswith(f"{space}/") and other != name
                       if other not in versions][:MOST_TRAPS]  # fmt: skip


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

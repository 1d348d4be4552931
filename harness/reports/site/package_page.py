"""Write the page of a package: supported range, last good combination, traps, every release, and a badge."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from packaging.version import Version

from harness.history import api_history
from harness.machine.files import guarded_files
from harness.model import Verdict
from harness.model.hostile_data import Unreadable, raise_unreadable
from harness.reports.answers import measured_cells, recommended, recommended_text, recommending
from harness.reports.answers.measured_cells import CellResult, Query, Wanted
from harness.reports.install_texts import install_commands
from harness.reports.site import addresses, excuses
from harness.reports.site.page_writer import PageWriter
from harness.reports.site.site_facts import SiteFacts
from harness.running import open_matrix

MOST = 1 << 24
SHOWN = 3
"""Combinations of a package that its page shows."""


@dataclass(frozen=True, kw_only=True)
class Release:
    """A release of a package that was measured; it `works` if some cell that ran it works as a whole."""

    version: str
    works: bool
    results: tuple[CellResult, ...]

    @property
    def measured(self) -> str:
        """Return the day of the newest result."""
        return max(one.cell.measured for one in self.results)[:10]

    @property
    def pythons(self) -> list[str]:
        """Return the Pythons that it was measured on."""
        return sorted({one.minor for one in self.results if one.minor}, key=Version)

    @property
    def good(self) -> int:
        """Return the number of its combinations that work."""
        return len({one.cell.id for one in self.results if one.cell.verdict is Verdict.WORKS})

    @property
    def count(self) -> int:
        """Return the number of its combinations."""
        return len({one.cell.id for one in self.results})


def releases(facts: SiteFacts, name: str) -> list[Release]:
    """Return the measured releases of a package, oldest first."""
    return group_releases(facts.cells, name, _works(name))


def group_releases(cells: Iterable[CellResult], name: str, works: Callable[[CellResult], bool]) -> list[Release]:
    """Return the releases of a package in these cells, oldest first; a release works if one of its cells does."""
    groups: dict[str, list[CellResult]] = {}
    for result in cells:
        version = result.version(name) if name in result.about else None
        if version:
            groups.setdefault(version, []).append(result)
    return [
        Release(version=version, works=any(map(works, groups[version])), results=tuple(groups[version]))
        for version in sorted(groups, key=Version)
    ]


def _works(name: str) -> Callable[[CellResult], bool]:
    return lambda one: one.works and name in one.exercised


def published(name: str) -> dict[str, str]:
    """Return the stable releases of a package with the day of each, oldest first; empty if its history is not kept."""
    path = open_matrix.data_folder() / "history" / f"{name}.json.gz"
    try:
        content = guarded_files.read(path, MOST)
        with raise_unreadable():
            history = api_history.decode(content)
    except Unreadable:
        return {}
    stable = (one for one in history.releases if not one.yanked and not Version(one.version).is_prerelease)
    return {one.version: (one.uploaded or "")[:10] for one in stable}


def release_of(version: str) -> Version:
    """Return the published release of a version: its local part, such as `+cpu`, names an index."""
    return Version(Version(version).public)


def inferred(facts: SiteFacts, name: str, measured: Sequence[Release], every: dict[str, str]) -> list[str]:
    """Return the releases that were not measured and lie between two that work, all else equal."""
    there = {release_of(one.version) for one in measured}
    cells = [one for one in facts.cells if one.version(name)]
    missing = [version for version in every if there and min(there) < Version(version) < max(there)]
    missing = [version for version in missing if Version(version) not in there]
    return [one for one in missing if recommended.infer_release(cells, Wanted.of(f"{name}=={one}"))]


@dataclass(frozen=True, kw_only=True, slots=True)
class Streak:
    """The newest releases that all end alike: since when, and what moved in the lock where it turned."""

    works: bool
    since: str
    length: int
    before: str = ""
    cells: tuple[str, str] = ("", "")
    moved: excuses.Moved | None = None


def streak(
    measured: Sequence[Release], good: Callable[[CellResult], bool] = lambda one: one.cell.good
) -> Streak | None:
    """Return the streak that the newest release is part of; None if nothing was measured.

    `good` says which cells work: at the turn two are compared that differ in this.
    """
    if not measured:
        return None
    last = measured[-1].works
    start = next((at + 1 for at in reversed(range(len(measured))) if measured[at].works != last), 0)
    since, length = measured[start].version, len(measured) - start
    if not start:
        return Streak(works=last, since=since, length=length)
    before, after = measured[start - 1], measured[start]
    pair = _turning(before, after, good)
    if pair is None:
        return Streak(works=last, since=since, length=length, before=before.version)
    first, second = (one.cell for one in pair)
    moved = excuses.differences(_with_versions(pair[0]), _with_versions(pair[1]))
    ids = first.id, second.id
    return Streak(works=last, since=since, length=length, before=before.version, cells=ids, moved=moved)


@dataclass(frozen=True, kw_only=True, slots=True)
class PartnerStreak:
    """The streak of a release of a package along the releases of another one."""

    name: str
    release: str
    streak: Streak


def partner_streaks(facts: SiteFacts, name: str, measured: Sequence[Release]) -> Iterator[PartnerStreak]:
    """Yield the streaks along the packages that are measured with this one, each for its newest release that has any.

    A package whose newest release does not work with this one is red, even if an older one works.
    """
    partners = Counter(other for one in facts.cells if name in one.subjects for other in one.subjects if other != name)
    for partner, _ in partners.most_common():
        for release in reversed(measured if measured_cells.is_heavy(partner) else ()):
            both = [one for one in release.results if {name, partner} <= one.subjects]
            along = group_releases(both, partner, _works(partner))
            held = streak(along) if len(along) > 1 else None
            if held:
                yield PartnerStreak(name=partner, release=release.version, streak=held)
                break


def _turning(
    before: Release, after: Release, good: Callable[[CellResult], bool]
) -> tuple[CellResult, CellResult] | None:
    """Return the two cells of one matrix on both sides of the turn that differ least."""
    pairs = [
        (first, second)
        for first in before.results
        for second in after.results
        if first.cell.matrix == second.cell.matrix and first.pins and second.pins
        if good(first) != good(second)
    ]
    return min(pairs, key=lambda pair: len(set(pair[0].pins.items()) ^ set(pair[1].pins.items())), default=None)


def _with_versions(result: CellResult) -> Any:
    from msgspec.structs import replace  # noqa: PLC0415 - the versions lie in the lock, once for all cells

    return replace(result.cell, installed=result.pins)


def write(facts: SiteFacts, writer: PageWriter) -> None:
    """Write a page and a badge for each package."""
    for name in facts.packages:
        measured = releases(facts, name)
        answer = recommended.build_answer(facts.cells, Query(wanted=(Wanted.of(name),)), SHOWN,
                                          recommended_text.try_command([name], None, None))  # fmt: skip
        works = [one.version for one in measured if one.works]
        address = addresses.package_page(name)
        every = published(name)
        there = {release_of(one.version) for one in measured}
        untested = [one for one in every if Version(one) not in there]
        guessed = inferred(facts, name, measured, every)
        writer.write(
            address,
            "package.html.j2",
            name=name,
            releases=[(one, facts.cell_links(each.cell.id for each in one.results)) for one in reversed(measured)],
            works=works,
            span=span(works),
            streak=streak(measured),
            partners=[(one, facts.package_address(one.name)) for one in partner_streaks(facts, name, measured)],
            best=answer.measured[0] if answer.measured else None,
            install=install_commands.command(answer.measured[0]) if answer.measured else "",
            doubtful=answer.doubtful,
            traps=list(_traps(facts, answer.red)),
            issues=[(one, facts.issue_address(one.id)) for one in facts.issues_of(name)],
            published=every,
            untested=untested,
            inferred=guessed,
            unknown=[one for one in untested if one not in guessed],
            cell_link=facts.cell_link,
            try_command=answer.next,
        )
        badge(writer, address, name, span(works) if works else "no measured combination works", works=bool(works))


def span(versions: Sequence[str]) -> str:
    """Return the first and the last of some versions in words."""
    if not versions:
        return "none"
    return versions[0] if len(versions) == 1 else f"{versions[0]} to {versions[-1]}"


def _traps(facts: SiteFacts, reds: Sequence[Any]) -> Iterator[dict[str, Any]]:
    for red in reds:
        yield {
            "red": red,
            "versions": [", ".join(f"{name} {version}" for name, version in each.items()) for each in red.versions],
            "issues": [(name, facts.issue_address(name)) for name in red.causes],
            "cells": facts.cell_links(red.cells[:SHOWN]),
        }


def badge(writer: PageWriter, address: str, name: str, text: str, *, works: bool) -> None:
    """Write the badge beside a page."""
    widths = [7 * len(name) + 12, 7 * len(text) + 12]
    writer.write(address.replace("index.html", "badge.svg"), "badge.svg.j2", left=name, right=text, widths=widths,
                 works=works)  # fmt: skip


def newest(facts: SiteFacts, names: Sequence[str]) -> recommending.Combination | None:
    """Return the newest combination of packages that works; None if there is none."""
    query = Query(wanted=tuple(map(Wanted.of, names)))
    answer = recommending.combinations(facts.cells, query)
    plain = [one for one in answer if not one.repaired and not one.brought]
    return next(iter(plain or answer), None)

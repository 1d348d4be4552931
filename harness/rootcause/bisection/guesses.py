"""Guess good ends for a bisection, from the bounds that packages declare and from the upload days of the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from packaging.specifiers import SpecifierSet

from harness.machine.store import cache_folder
from harness.packages.environments import site_packages
from harness.rootcause.bench import Trial
from harness.rootcause.bisection.candidates import Candidate
from harness.rootcause.repair import candidate_changes, failure_hints, times


def of_metadata(base: Trial, axis: str, line: Sequence[Candidate], *, offline: bool) -> Iterator[int]:
    """Yield places of releases that suit the packages beside them: by declared bounds, then by the day."""
    yield from _within(_declared(base, axis), line)
    yield from _of_the_day(base, axis, line, offline=offline)


def _declared(base: Trial, axis: str) -> Iterator[SpecifierSet]:
    """Yield the bounds that the failure names on the package, and those of the packages that are installed."""
    yield from failure_hints.bounds(base.reasons, {axis}).values()
    if base.record.key:
        yield from site_packages.bounds(cache_folder() / "environments" / base.record.key, axis)


def _within(bounds: Iterable[SpecifierSet], line: Sequence[Candidate]) -> Iterator[int]:
    """Yield the place of the newest release within an upper bound, and of the oldest within a lower one."""
    for bound in bounds:
        fitting = [place for place, one in enumerate(line) if bound.contains(one.name, prereleases=True)]
        upper = any(each.operator in {"<", "<=", "==", "~="} for each in bound)
        if fitting:
            yield fitting[-1] if upper else fitting[0]


def _of_the_day(base: Trial, axis: str, line: Sequence[Candidate], *, offline: bool) -> Iterator[int]:
    """Yield the newest release on the day of the newest package that the cell asks for beside this one."""
    installed = base.record.installed or {}
    versions = {name: installed.get(name) for name in candidate_changes.asked_for(base.cell)} | candidate_changes.pins(
        base.cell
    )
    others = {name: version for name, version in versions.items() if version and name != axis}
    days = [
        at for name, version in others.items() if (at := times.upload_time(base.cell, name, version, offline=offline))
    ]
    if days:
        before = [place for place, one in enumerate(line) if one.uploaded and one.uploaded[:10] <= max(days)[:10]]
        yield from before[-1:]

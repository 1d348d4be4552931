"""Tell which environments of a project behave, or look, otherwise between releases of a package."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import msgspec

from harness.model.measured import ReleaseSeries, SeriesStep
from harness.reports.answers.measured_cells import is_heavy
from harness.reports.projects.measured_sets import bare
from harness.reports.projects.project import Project
from harness.standalone.adapters import package as package_of_api
from harness.standalone.versions import is_version, version

UNDECIDED = "?"


class TaskChange(msgspec.Struct, frozen=True, kw_only=True):
    """An environment that changes at a release of a package, and how; `moved` other packages are not separated."""

    env: str
    package: str
    before: str
    after: str
    kind: str
    text: str
    moved: tuple[str, ...] = ()
    matrix: str


def concerning(series: Iterable[ReleaseSeries], project: Project, *, pictures: bool = False) -> list[ReleaseSeries]:
    """Return the series of environments that a project can make: it holds their packages."""
    return [
        each
        for each in series
        if each.pictures == pictures
        and each.package in project.packages
        and all(name in project.packages for name in (*each.where, *_brought(each)) if is_heavy(name))
    ]


def nearest(series: Iterable[ReleaseSeries], project: Project) -> list[ReleaseSeries]:
    """Return, of the series of each environment, those with the other versions of a project; all if there are none."""
    by_env: dict[tuple[str, str], list[ReleaseSeries]] = {}
    for each in series:
        by_env.setdefault((each.package, bare(each.env, each.api)), []).append(each)
    return [
        each for held in by_env.values() for each in [one for one in held if not other_versions(one, project)] or held
    ]


def _brought(each: ReleaseSeries) -> tuple[str, ...]:
    return (package_of_api(each.api),) if each.api else ()


def other_versions(each: ReleaseSeries, project: Project) -> dict[str, str]:
    """Return the heavy packages of a series whose version there is not one that a project admits."""
    return {
        name: version
        for name, version in each.where.items()
        if is_heavy(name) and not project.admits(name, version.partition("+")[0])
    }


def steps_within(each: ReleaseSeries, first: str, last: str) -> list[SeriesStep]:
    """Return the changes of a series on the way from one release to another, in either direction."""
    low, high = sorted((version(first), version(last)))
    return [step for step in each.steps if low < version(step.after) <= high or low <= version(step.before) < high]


def lasting(each: ReleaseSeries, steps: Sequence[SeriesStep]) -> list[SeriesStep]:
    """Return the steps at which the family changes, without those that only start from other states."""
    return [step for step in steps if alike(each, step.before, step.after) is False]


def alike(each: ReleaseSeries, first: str, last: str) -> bool | None:
    """Return whether an environment is the same with two releases; None where that was not measured or decided.

    A release that was not measured counts as the ones on both sides of it, where these are alike.
    """
    families = [_family(each, release) for release in (first, last)]
    if any(family is None or UNDECIDED in family for family in families):
        return True if first == last else None
    letters = [{*str(family).rstrip("'")} for family in families]
    return bool(letters[0] & letters[1])


def measured_there(each: ReleaseSeries, release: str) -> bool:
    """Return whether a release of a series was measured itself."""
    return release in each.releases or any(
        version(held) == version(release) for held in each.releases if is_version(held)
    )


def _family(each: ReleaseSeries, release: str) -> str | None:
    if release in each.releases:
        return each.families[each.releases.index(release)]
    wanted = version(release)
    held = [(version(text), family) for text, family in zip(each.releases, each.families, strict=True)]
    exact = next((family for release, family in held if release == wanted), None)
    if exact is not None:
        return exact
    below = [family for release, family in held if release < wanted]
    above = [family for release, family in held if release > wanted]
    return below[-1] if below and above and below[-1] == above[0] else None


def task_changes(each: ReleaseSeries, steps: Iterable[SeriesStep]) -> Iterator[TaskChange]:
    """Yield the changes of a series as entries of a document."""
    for step in steps:
        yield TaskChange(
            env=bare(each.env, each.api),
            package=each.package,
            before=step.before,
            after=step.after,
            kind=step.kind,
            text=step.text,
            moved=step.moved,
            matrix=each.matrix,
        )

"""Tell whether a release can be installed beside the other packages of a project, from what releases require."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping

import msgspec
from packaging.markers import default_environment

from harness.reports.projects.project import Project
from harness.standalone import packages
from harness.standalone.explain import missing_releases
from harness.standalone.explain.api_history import History, load_shipped
from harness.standalone.requirements import Requirement, requirement
from harness.standalone.versions import specifiers, unsatisfiable, version


class InstallAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """Whether releases can be installed; None where that is not on record.

    `blockers` are requirements of packages that stay, `moves` are other packages that have to change with them.
    """

    possible: bool | None
    text: str
    blockers: tuple[str, ...] = ()
    moves: tuple[str, ...] = ()


def install_answer(before: Project, after: Project, targets: Mapping[str, str]) -> InstallAnswer:
    """Return whether the `targets` (versions by name) can be installed in a project; `after` holds them already."""
    requires = _required(before)
    blockers = [
        f"{name} {before.packages[name].pinned or ''}".rstrip() + f" asks for {each.name}{each.specifiers}"
        for name, each in requires
        if each.name in targets and name not in targets and not each.specifiers.admits(targets[each.name])
    ]
    blockers += _unfit(before, targets)
    unknown = [name for name in targets if _release(load_shipped(name), targets[name]) is None]
    moves: dict[str, str] = {}
    for name, release in targets.items():
        for each in _requirements_of(name, release, after):
            if each.name in targets:
                if not each.specifiers.admits(targets[each.name]):
                    blockers.append(f"{name} {release} asks for {each.name}{each.specifiers}")
                continue
            declared = after.packages.get(each.name)
            if declared is None or declared.pinned is None or each.specifiers.admits(declared.pinned):
                continue
            moves[each.name] = f"{each.name}{each.specifiers} (now {declared.pinned})"
            others = [(asker, other) for asker, other in requires if other.name == each.name and asker not in targets]
            blockers += [
                f"{name} {release} asks for {each.name}{each.specifiers}, and {asker} for {each.name}{other.specifiers}"
                for asker, other in others
                if unsatisfiable([each.specifiers, other.specifiers])
            ]
    if blockers:
        return InstallAnswer(possible=False, text=f"no: {blockers[0]}", blockers=tuple(blockers))
    if unknown:
        return InstallAnswer(possible=None, text=f"not on record: what {' and '.join(unknown)} requires")
    with_it = f", and moves {', '.join(moves.values())}" if moves else ""
    return InstallAnswer(possible=True, text=f"yes{with_it}", moves=tuple(moves.values()))


def _release(history: History | None, text: str) -> Mapping[str, object] | None:
    """Return a release of a history; None if it is not there, or was not read."""
    releases = history.plain["releases"] if history else ()
    return next((each for each in releases if version(each["version"]) == version(text)), None)


def _unfit(project: Project, targets: Mapping[str, str]) -> Iterator[str]:
    """Yield why a release is not for the Python of a project."""
    python = ".".join(project.python.split(".")[:2]) if project.python else None
    for name, release in targets.items():
        history = load_shipped(name)
        entry = _release(history, release)
        if history is None or entry is None or python is None:
            continue
        if entry.get("yanked"):
            yield f"{name} {release} was withdrawn from the index"
        wants = str(entry.get("python") or "")
        if wants and not specifiers(wants).admits(f"{python}.99"):
            yield f"{name} {release} wants Python {wants}"
        elif not entry.get("sdist") and not missing_releases.has_wheel(entry, python):
            yield f"{name} {release} has no wheel for Python {python} on Linux, and no source"


def _required(project: Project) -> list[tuple[str, Requirement]]:
    """Return what the packages of a project require, each with the package that does."""
    if project.interpreter is not None:
        declared = packages.requirements_of(project.interpreter, os.environ)
        texts = [(name, text) for name, each in declared.items() for text in each]
    else:
        texts = [(name, text) for name in project.packages for text in _newest_requires(name, project)]
    return [(name, each) for name, text in texts if (each := _applying(text, project, project.packages.get(name)))]


def _newest_requires(name: str, project: Project) -> list[str]:
    """Return what the newest admitted release of a package requires."""
    history = load_shipped(name)
    if history is None:
        return []
    admits = project.packages[name].versions.admits
    return _texts_at(history, [place for place in history.read if admits(history.versions[place])][-1:])


def _texts_at(history: History, places: list[int]) -> list[str]:
    """Return the requirements that a history has at places of releases."""
    spans = history.plain.get("requires", {})
    return [
        text for text, runs in spans.items() if any(first <= place <= last for first, last in runs for place in places)
    ]


def _requirements_of(name: str, release: str, project: Project) -> Iterator[Requirement]:
    """Yield what a release requires."""
    history = load_shipped(name)
    if history is not None:
        places = [place for place in history.read if version(history.versions[place]) == version(release)]
        for text in _texts_at(history, places):
            each = _applying(text, project, project.packages.get(name))
            if each:
                yield each


def _applying(text: str, project: Project, declared: object) -> Requirement | None:
    """Return a requirement that applies to a project; None for one of another Python, or that cannot be parsed."""
    variables = {name: str(value) for name, value in default_environment().items()}
    if project.python:
        variables["python_version"] = ".".join(project.python.split(".")[:2])
        variables["python_full_version"] = project.python
    extras: frozenset[str] = getattr(declared, "extras", frozenset())
    try:
        each = requirement(text)
        return each if each.wanted(variables, extras) else None
    except (ValueError, KeyError):
        return None

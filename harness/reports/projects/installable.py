"""Tell whether a release can be installed beside the other packages of a project, from what releases require."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec
from packaging.markers import default_environment

from harness.reports.projects.project import Project
from harness.standalone.explain.api_history import History, has_wheel, load_shipped
from harness.standalone.requirements import Requirement, requirement
from harness.standalone.versions import specifiers, unsatisfiable, version


class InstallAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """An answer whether releases can be installed; None where that is not on record.

    `blockers` are requirements of packages that stay, `pulled` has the versions that other packages must have then.
    """

    possible: bool | None
    text: str
    blockers: tuple[str, ...] = ()
    pulled: dict[str, str] = {}


class Requirements:
    """The requirements of the packages of a project, read once."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.variables = _variables(project)
        self.required = [
            (name, each)
            for name, text in _texts(project)
            if (each := _applying(text, self.variables, _extras(project, name)))
        ]

    def answer(self, after: Project, targets: Mapping[str, str]) -> InstallAnswer:
        """Return whether the `targets` (versions by name) can be installed; `after` is the project with them."""
        blockers = [*self._kept_out(targets), *_unfit(self.project, targets)]
        pulled: dict[str, str] = {}
        for name, release in targets.items():
            for each in _requirements_of(name, release, self.variables, _extras(after, name)):
                if each.name in targets:
                    if not each.specifiers.admits(targets[each.name]):
                        blockers.append(f"{name} {release} asks for {each.name}{each.specifiers}")
                    continue
                declared = after.packages.get(each.name)
                if declared and declared.pinned and not each.specifiers.admits(declared.pinned):
                    pulled[each.name] = str(each.specifiers)
                    blockers += self._torn(f"{name} {release}", each, targets)
        if blockers:
            return InstallAnswer(possible=False, text=f"no: {blockers[0]}", blockers=tuple(blockers))
        unknown = [name for name in targets if _release(load_shipped(name), targets[name]) is None]
        if unknown:
            return InstallAnswer(possible=None, text=f"not on record: what {' and '.join(unknown)} requires")
        words = [f"{name}{versions} (now {after.packages[name].pinned})" for name, versions in pulled.items()]
        with_it = f", and moves {', '.join(words)}" if words else ""
        return InstallAnswer(possible=True, text=f"yes{with_it}", pulled=pulled)

    def _kept_out(self, targets: Mapping[str, str]) -> Iterator[str]:
        """Yield the requirements of packages that stay which a target does not meet."""
        for name, each in self.required:
            if each.name in targets and name not in targets and not each.specifiers.admits(targets[each.name]):
                held = self.project.packages[name].pinned
                yield f"{name}{f' {held}' if held else ''} asks for {each.name}{each.specifiers}"

    def _torn(self, target: str, wanted: Requirement, targets: Mapping[str, str]) -> Iterator[str]:
        """Yield the requirements of packages that stay which cannot be met together with one of a target."""
        others = ((name, each) for name, each in self.required if each.name == wanted.name and name not in targets)
        for name, other in others:
            if unsatisfiable([wanted.specifiers, other.specifiers]):
                mine, theirs = (f"{wanted.name}{each.specifiers}" for each in (wanted, other))
                yield f"{target} asks for {mine}, and {name} for {theirs}"


def _release(history: History | None, text: str) -> Mapping[str, object] | None:
    """Return a release of a history; None if it is not there, or was not read."""
    releases = history.plain["releases"] if history else ()
    exact = next((each for each in releases if each["version"] == text), None)
    return exact or next((each for each in releases if version(each["version"]) == version(text)), None)


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
        elif not entry.get("sdist") and not has_wheel(entry, python):
            yield f"{name} {release} has no wheel for Python {python} on Linux, and no source"


def _texts(project: Project) -> list[tuple[str, str]]:
    """Return what the packages of a project require, each with the package that does."""
    if project.interpreter is None:
        return [(name, text) for name in project.packages for text in _newest_requires(name, project)]
    required = project.requirements
    return [(name, text) for name, texts in required.items() if name in project.packages for text in texts]


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


def _requirements_of(
    name: str, release: str, variables: Mapping[str, str], extras: frozenset[str]
) -> Iterator[Requirement]:
    """Yield what a release requires."""
    history = load_shipped(name)
    if history is not None:
        places = [place for place in history.read if version(history.versions[place]) == version(release)]
        for text in _texts_at(history, places):
            each = _applying(text, variables, extras)
            if each:
                yield each


def _variables(project: Project) -> dict[str, str]:
    variables = {name: str(value) for name, value in default_environment().items()}
    if project.python:
        variables["python_version"] = ".".join(project.python.split(".")[:2])
        variables["python_full_version"] = project.python
    return variables


def _extras(project: Project, name: str) -> frozenset[str]:
    declared = project.packages.get(name)
    return declared.extras if declared else frozenset()


def _applying(text: str, variables: Mapping[str, str], extras: frozenset[str]) -> Requirement | None:
    """Return a requirement that applies; None for one of another Python, or one that cannot be parsed."""
    try:
        each = requirement(text)
        return each if each.wanted(variables, extras) else None
    except (ValueError, KeyError):
        return None

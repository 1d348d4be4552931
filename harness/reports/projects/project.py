"""Hold the packages of a project, and read them from requirement files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from packaging.markers import UndefinedComparison, UndefinedEnvironmentName, default_environment
from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from harness.model import replace, requirement_texts
from harness.model.errors import BadInput
from harness.standalone.explain.api_history import History, load_shipped
from harness.standalone.versions import Specifiers, specifiers, unsatisfiable, version

DEEPEST = 4
"""Requirements of requirements that are followed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Declared:
    """A package of a project: the versions that it admits, and its extras.

    `pinned` is the version if only one is admitted. `by` is the package that requires it where the project does not
    name it itself.
    """

    name: str
    versions: Specifiers
    pinned: str | None = None
    extras: frozenset[str] = frozenset()
    by: str | None = None

    @property
    def text(self) -> str:
        """Return it as a requirement."""
        clauses = sorted(self.versions.clauses, key=lambda clause: version(clause.version.removesuffix(".*")))
        return f"{self.name}{','.join(map(str, clauses))}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Project:
    """The packages of a project by name.

    `source` names it in sentences. `pythons` are the Pythons that it admits, `python` the only one, such as `3.11.7`.
    `interpreter` is the Python of an environment at hand, `requirements` what the packages in it require. `unjudged`
    are requirements that cannot be judged, each with the reason. `conflicts` names packages of which no version fits.
    """

    source: str
    packages: Mapping[str, Declared]
    pythons: Specifiers
    python: str | None = None
    interpreter: str | None = None
    unjudged: tuple[str, ...] = ()
    conflicts: Mapping[str, str] = field(default_factory=dict)
    constraints: Mapping[str, Specifiers] = field(default_factory=dict)
    requirements: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def admits(self, name: str, version: str) -> bool:
        """Return whether the project admits a version of a package; one that it does not name may have any."""
        declared = self.packages.get(name)
        return declared is None or declared.versions.admits(version)

    def admits_python(self, version: str) -> bool:
        """Return whether the project admits a Python: of an environment, any patch release of the same minor."""
        if self.python:
            return version.split(".")[:2] == self.python.split(".")[:2]
        return self.pythons.admits(version)


def with_versions(project: Project, versions: Mapping[str, str]) -> Project:
    """Return the project with other versions of some packages."""
    moved = {
        name: Declared(name=name, versions=specifiers(f"=={version}"), pinned=version)
        for name, version in versions.items()
    }
    return replace(project, packages={**project.packages, **moved})


# --- requirement files -----------------------------------------------------------------------------------------


def read_files(paths: Sequence[Path], extras: Sequence[str], groups: Sequence[str], python: str | None) -> Project:
    """Return the packages that requirement files ask for, and those that their extras bring. Raises BadInput."""
    from harness.packages.requirement_files import inputs  # noqa: PLC0415 - start-up: an environment needs no reader
    from harness.packages.requirement_files.entry import CONDA_PACKAGE  # noqa: PLC0415 - start-up

    given = inputs.read(paths, extras=extras, groups=groups)
    source = ", ".join(map(str, paths))
    variables = _marker_variables(python)
    texts: dict[str, list[Requirement]] = {}
    unjudged = [line for line in given.not_modelled if not line.endswith(CONDA_PACKAGE)]
    for text in (*given.requirements, *given.conda):
        requirement = requirement_texts.requirement(text)
        if requirement.url:
            unjudged.append(f"{requirement.name}: taken from an address, which no index knows")
        elif _applies(requirement, variables):
            texts.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    # A pyproject.toml may be there for tools alone.
    if not texts and not unjudged and all(path.suffix != ".toml" for path in paths):
        message = f"{source}: names no package"
        raise BadInput(message)
    constraints = _bounds(given.constraints, variables)
    overrides = _bounds(given.overrides, variables)
    declared = {name: _declared(name, each, constraints, overrides) for name, each in texts.items()}
    project = Project(
        source=source,
        packages=declared,
        pythons=specifiers(f"=={python}.*" if python else given.python or ""),
        unjudged=tuple(unjudged),
        conflicts=dict(_conflicts(texts, constraints, overrides)),
        constraints={**constraints, **overrides},
    )
    return replace(project, packages={**_implied(project, variables), **declared})


def _marker_variables(python: str | None) -> dict[str, str]:
    variables: dict[str, str] = {name: str(value) for name, value in default_environment().items()}
    if python:
        whole = python if python.count(".") > 1 else f"{python}.0"
        variables |= {"python_version": ".".join(python.split(".")[:2]), "python_full_version": whole}
    return variables


def _applies(requirement: Requirement, variables: Mapping[str, str], extras: Sequence[str] = ("",)) -> bool:
    """Return whether a requirement applies, by its marker; one that cannot be evaluated does."""
    if requirement.marker is None:
        return True
    try:
        return any(requirement.marker.evaluate({**variables, "extra": extra}) for extra in extras)
    except (UndefinedComparison, UndefinedEnvironmentName):
        return True


def _bounds(texts: Sequence[str], variables: Mapping[str, str]) -> dict[str, Specifiers]:
    """Return the versions that constraints or overrides admit, by package."""
    bounds: dict[str, list[str]] = {}
    for text in texts:
        requirement = requirement_texts.requirement(text)
        if not requirement.url and _applies(requirement, variables):
            bounds.setdefault(canonicalize_name(requirement.name), []).append(str(requirement.specifier))
    return {name: specifiers(",".join(filter(None, parts))) for name, parts in bounds.items()}


def _declared(
    name: str,
    requirements: Sequence[Requirement],
    constraints: Mapping[str, Specifiers],
    overrides: Mapping[str, Specifiers],
) -> Declared:
    if name in overrides:
        versions = overrides[name]
    else:
        parts = [str(requirement.specifier) for requirement in requirements]
        parts += [str(constraints[name])] if name in constraints else []
        versions = specifiers(",".join(dict.fromkeys(filter(None, parts))))
    extras = frozenset(canonicalize_name(extra) for requirement in requirements for extra in requirement.extras)
    return Declared(name=name, versions=versions, pinned=_pinned(versions), extras=extras)


def _pinned(versions: Specifiers) -> str | None:
    pins = [clause.version for clause in versions.clauses if clause.operator in {"==", "==="}]
    pins = [pin for pin in pins if not pin.endswith("*")]
    if len(versions.clauses) == 1:
        return pins[0] if pins else None
    return next((pin for pin in pins if versions.admits(pin)), None)


def _conflicts(
    texts: Mapping[str, Sequence[Requirement]],
    constraints: Mapping[str, Specifiers],
    overrides: Mapping[str, Specifiers],
) -> Iterator[tuple[str, str]]:
    for name, requirements in texts.items():
        parts = [specifiers(str(requirement.specifier)) for requirement in requirements]
        parts += [constraints[name]] if name in constraints else []
        if name not in overrides and unsatisfiable(parts):
            yield name, f"{name}: no version meets {' and '.join(dict.fromkeys(f'{name}{part}' for part in parts))}"


# --- what others bring -----------------------------------------------------------------------------------------


def _implied(project: Project, variables: Mapping[str, str]) -> dict[str, Declared]:
    """Return the packages that the requirements of the project's packages bring, by the history of each."""
    implied: dict[str, Declared] = {}
    waiting = [(declared, 0) for declared in project.packages.values()]
    for declared, depth in waiting:
        history = load_shipped(declared.name) if depth < DEEPEST else None
        for requirement in _requirements_of(history, declared, variables) if history else ():
            name = canonicalize_name(requirement.name)
            if name in project.packages or name in implied:
                continue
            parts = [str(requirement.specifier), str(project.constraints.get(name, ""))]
            versions = specifiers(",".join(filter(None, parts)))
            extras = frozenset(canonicalize_name(extra) for extra in requirement.extras)
            implied[name] = Declared(
                name=name, versions=versions, pinned=_pinned(versions), extras=extras, by=declared.name
            )
            waiting.append((implied[name], depth + 1))
    return implied


def _requirements_of(history: History, declared: Declared, variables: Mapping[str, str]) -> Iterator[Requirement]:
    """Yield what the newest admitted release of a package requires, with the extras asked for."""
    admitted = (place for place in reversed(history.read) if declared.versions.admits(history.versions[place]))
    newest = next(admitted, None)
    for text, spans in history.plain.get("requires", {}).items() if newest is not None else ():
        if any(first <= newest <= last for first, last in spans):
            try:
                requirement = requirement_texts.requirement(text)
            except InvalidRequirement:  # gym 0.21.0 has one that no resolver accepts
                continue
            if _applies(requirement, variables, ("", *declared.extras)):
                yield requirement

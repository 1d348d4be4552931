"""Read pyproject.toml."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from packaging.dependency_groups import resolve_dependency_groups
from packaging.utils import canonicalize_name

from harness.model import IndexSettings, requirement_texts, schema
from harness.model.errors import BadInput
from harness.packages.requirement_files.entry import Inputs, Parsed, Source, check_number, quote, requirement, where_in


class _Table(msgspec.Struct, frozen=True, kw_only=True, rename="kebab"):
    """The keys that are read; others are other tools' business."""


class _Project(_Table, frozen=True):
    name: str = ""
    requires_python: str = ""
    dynamic: tuple[str, ...] = ()
    dependencies: tuple[str, ...] = ()
    optional_dependencies: dict[str, tuple[str, ...]] = {}


class _Index(_Table, frozen=True):
    url: str
    default: bool = False
    explicit: bool = False


class _Uv(_Table, frozen=True):
    constraint_dependencies: tuple[str, ...] = ()
    override_dependencies: tuple[str, ...] = ()
    build_constraint_dependencies: tuple[str, ...] = ()
    prerelease: str | None = None
    index_url: str | None = None
    extra_index_url: tuple[str, ...] = ()
    index: tuple[_Index, ...] = ()
    sources: dict[str, Any] = {}


class _Poetry(_Table, frozen=True):
    dependencies: dict[str, Any] = {}


class _Tool(_Table, frozen=True):
    uv: _Uv = _Uv()
    poetry: _Poetry = _Poetry()


class _Document(_Table, frozen=True):
    project: _Project = _Project()
    dependency_groups: dict[str, Any] = {}
    tool: _Tool = _Tool()


FILES = ("pyproject.toml", "setup.py", "setup.cfg")
"""One of these makes a folder a project."""


@dataclass(frozen=True, kw_only=True, slots=True)
class About:
    """The metadata of a project in its pyproject.toml; `extras` is None if only a build tells them."""

    name: str
    python: str
    extras: tuple[str, ...] | None
    groups: Mapping[str, Any]


def about(text: str, name: str = "pyproject.toml") -> About:
    """Read the metadata of a project from its pyproject.toml; `name` is the file's in messages."""
    document = schema.load_toml(text, _Document, name)
    project = document.project
    is_static = bool(project.name) and "optional-dependencies" not in project.dynamic
    return About(
        name=canonicalize_name(project.name),
        python=project.requires_python,
        extras=tuple(map(canonicalize_name, project.optional_dependencies)) if is_static else None,
        groups={canonicalize_name(group): lines for group, lines in document.dependency_groups.items()},
    )


def pyproject(text: str, source: Source, extras: Iterable[str], groups: Iterable[str]) -> Parsed:
    """Read the dependencies of a project, with some of its extras and dependency groups; the project stays out."""
    document = schema.load_toml(text, _Document, source.name)
    project = document.project
    optional = {canonicalize_name(name): lines for name, lines in project.optional_dependencies.items()}
    with schema.locate_errors(source.name, "project", "requires-python"):
        inputs = Inputs(python=str(requirement_texts.specifiers(project.requires_python)) or None)
    inputs += Inputs(not_modelled=tuple(_unread(text, source, document)))
    wanted = [*project.dependencies, *_with_extras(canonicalize_name(project.name), optional, extras)]
    wanted += _grouped(document.dependency_groups, groups, source)
    check_number(len(wanted), source)
    for line in dict.fromkeys(wanted):
        inputs += requirement(line, source, where_in(text, quote(line), source))
    inputs += _resolution(document.tool.uv)
    group_names = tuple(canonicalize_name(name) for name in document.dependency_groups)
    return Parsed(inputs=inputs, extras=tuple(optional), groups=group_names)


def _grouped(table: Mapping[str, Any], groups: Iterable[str], source: Source) -> tuple[str, ...]:
    group_names = {canonicalize_name(name) for name in table}
    chosen = [group for group in groups if canonicalize_name(group) in group_names]
    return resolve_groups(table, chosen, f"{source.name}: dependency-groups")


def resolve_groups(table: Mapping[str, Any], groups: Iterable[str], where: str) -> tuple[str, ...]:
    """Return the requirements of dependency groups. Raises BadInput, which `where` begins."""
    try:
        return resolve_dependency_groups(table, *groups)
    except ExceptionGroup as error:
        message = f"{where}: {str(error.exceptions[0]).splitlines()[0]}"
        raise BadInput(message) from None


def _with_extras(project: str, optional: Mapping[Any, Sequence[str]], extras: Iterable[str]) -> list[str]:
    """Return the lines of extras; one that names the project itself (`all = ["project[mujoco]"]`) adds those extras."""
    lines: list[str] = []
    waiting = [canonicalize_name(extra) for extra in extras]
    for extra in waiting:
        for line in optional.get(extra, ()):
            own = re.fullmatch(r"([\w.-]+)\s*\[([^]]*)\]\s*", line)
            if own and canonicalize_name(own[1]) == project:
                more = [canonicalize_name(name.strip()) for name in own[2].split(",")]
                waiting += [name for name in more if name not in waiting]
            else:
                lines.append(line)
    return lines


def _unread(text: str, source: Source, document: _Document) -> Iterator[str]:
    for name in document.project.dynamic:
        if name in {"dependencies", "optional-dependencies", "requires-python"}:
            where = where_in(text, rf"(?s)dynamic\s*=.*?{quote(name)}", source)
            yield f"{where}: {name} is dynamic: only a build of the project tells it"
    if document.tool.poetry.dependencies:
        where = where_in(text, r"tool\.poetry\.dependencies", source)
        yield f"{where}: tool.poetry.dependencies: Poetry's own format is not supported; export requirements.txt"
    for name in document.tool.uv.sources:
        where = where_in(text, rf"(?s)tool\.uv\.sources.*?{re.escape(name)}", source)
        yield f"{where}: tool.uv.sources.{name}: sources are not supported; {name} is taken from the indexes"
    for index in document.tool.uv.index:
        if index.explicit:
            where = where_in(text, quote(index.url), source)
            yield f"{where}: {index.url}: an explicit index is not supported"


def _resolution(table: _Uv) -> Inputs:
    """Return the resolution settings and the indexes of `[tool.uv]`, without explicit indexes."""
    indexes = [index for index in table.index if not index.explicit]
    return Inputs(
        constraints=table.constraint_dependencies,
        overrides=table.override_dependencies,
        build_constraints=table.build_constraint_dependencies,
        prerelease=table.prerelease,
        index=IndexSettings(
            default=next((index.url for index in indexes if index.default), table.index_url),
            extra=(*(index.url for index in indexes if not index.default), *table.extra_index_url),
        ),
    )

"""Read the metadata of a project from pyproject.toml, or from the literals of an older setup.py."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
from packaging.specifiers import InvalidSpecifier
from packaging.utils import canonicalize_name

from harness.ci.drafts import poetry
from harness.model import decoding, requirement_texts, schema

PYTHONS = tuple(f"3.{minor}" for minor in range(7, 15))
"""Those that cells can have."""

_CLASSIFIER = re.compile(r"Programming Language :: Python :: (3\.\d+)")
_ENV_ID = re.compile(r"(?:[\w:-]+/)?[\w:.-]+-v\d+")
_PLUGINS = "gymnasium.envs"


@dataclass(frozen=True, kw_only=True, slots=True)
class Project:
    """A project: its normalised name, the Pythons and dependencies that it claims, whether it is a gymnasium plugin.

    `extras` and `groups` are its extras and dependency groups with their requirements, `test_paths` says whether
    pytest's settings name the folders of its tests.
    """

    name: str
    pythons: tuple[str, ...] = ()
    dependencies: tuple[str, ...] = ()
    plugin: bool = False
    extras: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    groups: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    test_paths: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Case:
    """An environment of a project; `imports` register it, `note` is what was seen when it was tried."""

    env: str
    api: str
    imports: tuple[str, ...] = ()
    note: str | None = None


class _Table(msgspec.Struct, frozen=True, kw_only=True, rename="kebab"):
    name: str = ""
    requires_python: str = ""
    classifiers: tuple[str, ...] = ()
    dependencies: tuple[str, ...] = ()
    optional_dependencies: dict[str, tuple[str, ...]] = {}
    entry_points: dict[str, Any] = {}


class _Document(msgspec.Struct, frozen=True, kw_only=True, rename="kebab"):
    project: _Table = _Table()
    dependency_groups: dict[str, tuple[Any, ...]] = {}
    tool: dict[str, Any] = {}


def read(pyproject: str, setup: str, folder: str) -> Project:
    """Read a project from the texts of its files, empty if missing. `folder` names a project without a name."""
    document = schema.load_toml(pyproject, _Document, "pyproject.toml")
    table, own = document.project, document.tool.get("poetry")
    if not table.name and isinstance(own, Mapping):
        table = decoding.convert(poetry.project_table(own), _Table)
    if not table.name and setup:
        table = _literals(setup)
    return Project(
        name=canonicalize_name(table.name or folder) or "project",
        pythons=_pythons(table),
        dependencies=table.dependencies,
        plugin=_PLUGINS in table.entry_points,
        extras={canonicalize_name(extra): lines for extra, lines in table.optional_dependencies.items()},
        groups={canonicalize_name(group): lines for group, lines in document.dependency_groups.items()},
        test_paths=_names_tests(document.tool),
    )


def _names_tests(tool: Mapping[str, Any]) -> bool:
    """Return whether pytest's settings name the folders of the tests."""
    settings = tool.get("pytest")
    options = settings.get("ini_options") if isinstance(settings, Mapping) else None
    return isinstance(options, Mapping) and bool(options.get("testpaths"))


def environment_ids(text: str) -> Iterator[str]:
    """Yield the ids of the environments that a module registers by calls with literals."""
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and _called(node.func) == "register":
            named = [keyword.value for keyword in node.keywords if keyword.arg == "id"] or node.args[:1]
            for value in named:
                if isinstance(value, ast.Constant) and _ENV_ID.fullmatch(str(value.value)):
                    yield str(value.value)


def _pythons(table: _Table) -> tuple[str, ...]:
    """Return the Pythons that the classifiers name, else those that `requires-python` allows. Empty without either."""
    named = {classifier[1] for line in table.classifiers if (classifier := _CLASSIFIER.fullmatch(line.strip()))}
    if not named and not table.requires_python:
        return ()
    with schema.locate_errors("pyproject.toml", "project", "requires-python"):
        try:
            allowed = requirement_texts.specifiers(table.requires_python)
        except InvalidSpecifier:
            message = f'"{table.requires_python}" is not a specifier such as ">=3.10"'
            raise ValueError(message) from None
    # A bound such as >=3.12.1 refuses the first patch release of a Python that it allows; 99 stands for a late one.
    fitting = (python for python in PYTHONS if any(allowed.contains(f"{python}.{patch}") for patch in (0, 99)))
    return tuple(python for python in fitting if python in named or not named)


def _literals(setup: str) -> _Table:
    """Return the arguments of `setup()` that are literals in setup.py."""
    try:
        tree = ast.parse(setup)
    except (SyntaxError, ValueError):
        return _Table()
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and _called(node.func) == "setup"]
    given = {word.arg: value for call in calls for word in call.keywords if (value := _literal(word.value)) is not None}
    plugins = given.get("entry_points")
    return _Table(
        name=_text(given, "name"),
        requires_python=_text(given, "python_requires"),
        classifiers=_texts(given, "classifiers"),
        dependencies=_texts(given, "install_requires"),
        optional_dependencies=_extras(given.get("extras_require")),
        entry_points=plugins if isinstance(plugins, dict) else {},
    )


def _extras(value: object) -> dict[str, tuple[str, ...]]:
    """Return the extras of a setup.py; a marker in an extra's name, as in `test:python_version<'3.8'`, is dropped."""
    lines = value.items() if isinstance(value, dict) else ()
    return {str(name).partition(":")[0]: _texts({name: asked}, name) for name, asked in lines}


def _called(function: ast.expr) -> str | None:
    """Return the last part of a function's name."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else None


def _literal(node: ast.expr) -> object:
    try:
        return ast.literal_eval(node)
    except (ValueError, TypeError):
        return None


def _text(given: Mapping[str | None, object], key: str) -> str:
    value = given.get(key)
    return value if isinstance(value, str) else ""


def _texts(given: Mapping[str | None, object], key: str) -> tuple[str, ...]:
    value = given.get(key)
    return tuple(map(str, value)) if isinstance(value, Sequence) and not isinstance(value, str) else ()

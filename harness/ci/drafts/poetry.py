"""Read `[tool.poetry]` as if it were a `[project]` table."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from packaging.version import InvalidVersion, Version

_CARET = re.compile(r"([\^~])\s*(\d[\w.]*)")


def project_table(poetry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of a `[project]` table that Poetry's own table stands for; what cannot be read is left out."""
    # Poetry lists Python itself among the dependencies.
    dependencies = {name: value for name, value in _table(poetry.get("dependencies")).items() if name != "python"}
    lines = {name: line for name, value in dependencies.items() if (line := _requirement(name, value))}
    optional = {name for name, value in dependencies.items() if isinstance(value, Mapping) and value.get("optional")}
    extras = {
        extra: [lines.get(name, name) for name in names if isinstance(name, str)]
        for extra, names in _table(poetry.get("extras")).items()
        if isinstance(names, list)
    }
    return {
        "name": str(poetry.get("name", "")),
        "requires-python": _specifier(_table(poetry.get("dependencies")).get("python", "")),
        "classifiers": [line for line in poetry.get("classifiers", ()) if isinstance(line, str)],
        "dependencies": [line for name, line in lines.items() if name not in optional],
        "optional-dependencies": extras,
    }


def groups(poetry: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return Poetry's dependency groups as lists of requirements; they are no groups that an installer knows."""
    requirements = {}
    for name, table in _table(poetry.get("group")).items():
        dependencies = _table(_table(table).get("dependencies"))
        requirements[name] = [line for package, value in dependencies.items() if (line := _requirement(package, value))]
    return requirements


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _requirement(name: str, value: object) -> str | None:
    """Return the requirement of one package; None of a path, a repository or several alternatives."""
    if isinstance(value, Mapping):
        extras = value.get("extras")
        name += f"[{','.join(map(str, extras))}]" if isinstance(extras, list) else ""
        value = value.get("version")
    return f"{name}{_specifier(value)}" if isinstance(value, str) else None


def _specifier(text: object) -> str:
    """Return a specifier for Poetry's `^1.2`, `~1.2`, `*` or a plain version."""
    parts = [part.strip() for part in str(text).split(",")]
    return ",".join(found for part in parts for found in _bounds(part))


def _bounds(part: str) -> Iterator[str]:
    caret = _CARET.fullmatch(part)
    if caret:
        yield f">={caret[2]}"
        yield from _next(caret[1], caret[2])
    elif part and part[0].isdigit():
        yield f"=={part}"
    elif part != "*":
        yield part


def _next(sign: str, version: str) -> Iterator[str]:
    """Yield the upper bound of `^` (the first part that is not 0 stays) and of `~` (the second one stays)."""
    try:
        release = Version(version).release
    except InvalidVersion:
        return
    position = min(2, len(release)) if sign == "~" else next((at for at, part in enumerate(release, 1) if part), 1)
    yield f"<{'.'.join(map(str, (*release[: position - 1], release[position - 1] + 1)))}"

"""Write a fix, as a machine applies it, as commands that a person pastes into a shell."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

UNTYPED = frozenset({"overlay", "overrides", "build_constraints", "build_variables", "as_of"})
"""Parts of a fix that a resolver is told in a file, or that patch a wheel: no short command does the same."""


def commands(fix: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the commands that apply a fix to an environment; none where it is told in words alone."""
    return () if UNTYPED & {*fix} else tuple(_commands(fix))


def _commands(fix: Mapping[str, Any]) -> Iterator[str]:
    if fix.get("python"):
        yield f"uv venv --python {shlex.quote(str(fix['python']))}"
    if fix.get("uninstall"):
        yield f"pip uninstall -y {shlex.join(map(str, fix['uninstall']))}"
    wanted = [str(each) for key in ("requirements", "constraints") for each in fix.get(key) or ()]
    if wanted:
        wheels = [word for each in fix.get("only_binary") or () for word in ("--only-binary", str(each))]
        yield f"pip install {shlex.join([*wheels, *dict.fromkeys(wanted)])}"
    for name, value in (fix.get("environment") or {}).items():
        yield f"export {shlex.quote(str(name))}={shlex.quote(str(value))}" if value else f"unset {shlex.quote(name)}"

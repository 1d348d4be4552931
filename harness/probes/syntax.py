"""Digest Python source by its syntax tree: comments, docstrings and layout change nothing.

The standard library only, and equal under every Python that the host runs on: `ast.dump` is not.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Collection, Iterator


def digest(tree: ast.Module, but: Collection[str] = ()) -> str:
    """Return 32 hexadecimal digits that tell what a source does; assignments to the names in `but` are left out."""
    tree = ast.Module(body=[node for node in tree.body if not _assigns(node, but)], type_ignores=[])
    combined = hashlib.sha256()
    for piece in _written(tree):
        combined.update(piece.encode("utf-8", "backslashreplace") + b"\0")
    return combined.hexdigest()[:32]


def neighbours(tree: ast.Module) -> tuple[str, ...]:
    """Return the files that a source imports from its own package, by `from .name import` or `from . import name`."""
    modules: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            modules += [node.module] if node.module else [alias.name for alias in node.names]
    return tuple(f"{name}.py" for name in dict.fromkeys(modules))


def _assigns(node: ast.stmt, names: Collection[str]) -> bool:
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and len(node.targets) == 1
        and node.targets[0].id in names
    )


def _written(value: object) -> Iterator[str]:
    """Yield a tree piece by piece; what is empty is left out, as newer Pythons have fields that older ones lack."""
    if isinstance(value, ast.AST):
        yield f"({type(value).__name__}"
        for name in value._fields:
            part = getattr(value, name, None)
            if part is None and not (isinstance(value, ast.Constant) and name == "value"):
                continue
            if isinstance(part, list) and not (part := [one for one in part if not _says_nothing(one, value)]):
                continue
            yield name
            yield from _written(part)
        yield ")"
    elif isinstance(value, list):
        yield "["
        for item in value:
            yield from _written(item)
        yield "]"
    else:
        # `repr` depends on the Unicode tables of the Python that runs, so `!a` writes ASCII alone.
        yield f"{type(value).__name__} {value!a}"


def _says_nothing(node: object, above: ast.AST) -> bool:
    """Tell a text alone, as a docstring is, and the empty text that Python 3.12.1 ends some f-strings with."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return isinstance(above, ast.JoinedStr) and isinstance(node, ast.Constant) and node.value == ""

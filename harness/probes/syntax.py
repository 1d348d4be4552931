"""Digest Python source by its syntax tree: comments, docstrings and layout change nothing.

The standard library only, and equal under every Python that the host runs on: `ast.dump` is not.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Collection

HOLDERS = (ast.stmt, ast.excepthandler, ast.match_case)
"""Nodes that can be an import, or hold one."""


def digest(tree: ast.Module, but: Collection[str] = ()) -> str:
    """Return 32 hexadecimal digits that tell what a source does; assignments to the names in `but` are left out."""
    pieces: list[str] = []
    _write(ast.Module(body=[node for node in tree.body if not _assigns(node, but)], type_ignores=[]), pieces)
    text = "".join(f"{piece}\0" for piece in pieces)
    return hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()[:32]


def neighbours(tree: ast.Module) -> tuple[str, ...]:
    """Return the files that a source imports from its own package, by `from .name import` or `from . import name`."""
    modules: list[str] = []
    waiting: list[ast.AST] = [tree]
    for node in waiting:  # `ast.walk` would look into every expression, too
        if isinstance(node, ast.ImportFrom) and node.level:
            modules += [node.module] if node.module else [alias.name for alias in node.names]
        parts = (getattr(node, name, None) for name in node._fields)
        waiting += [one for part in parts if isinstance(part, list) for one in part if isinstance(one, HOLDERS)]
    return tuple(f"{name}.py" for name in dict.fromkeys(modules))


def _assigns(node: ast.stmt, names: Collection[str]) -> bool:
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and len(node.targets) == 1
        and node.targets[0].id in names
    )


def _write(value: object, pieces: list[str]) -> None:
    """Add a tree piece by piece; what is empty is left out, as newer Pythons have fields that older ones lack."""
    if isinstance(value, ast.AST):
        pieces.append(f"({type(value).__name__}")
        for name in value._fields:
            part = getattr(value, name, None)
            if part is None and not (isinstance(value, ast.Constant) and name == "value"):
                continue
            if isinstance(part, list) and not (part := [one for one in part if not _says_nothing(one, value)]):
                continue
            pieces.append(name)
            _write(part, pieces)
        pieces.append(")")
    elif isinstance(value, list):
        pieces.append("[")
        for item in value:
            _write(item, pieces)
        pieces.append("]")
    else:
        # `repr` depends on the Unicode tables of the Python that runs, so `!a` writes ASCII alone.
        pieces.append(f"{type(value).__name__} {value!a}")


def _says_nothing(node: object, above: ast.AST) -> bool:
    """Tell a text alone, as a docstring is, and the empty text that Python 3.12.1 ends some f-strings with."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return isinstance(above, ast.JoinedStr) and isinstance(node, ast.Constant) and node.value == ""

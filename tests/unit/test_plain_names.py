"""Hold names to plain English: a name is a thing or an action, and no participle or pronoun of this list."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FORBIDDEN = frozenset(["told", "said", "found", "made", "known", "one", "those", "thereof", "asked", "kept"])
FORMAT = frozenset(
    {
        ("CaseEntry", "told"), ("CellEntry", "asked"), ("Cell", "asked"), ("Started", "kept"), ("Recommended", "asked"),
        ("Recommended", "found"), ("Row", "known"), ("Trouble", "known"), ("SuiteChange", "known"), ("Tried", "said"),
        ("BisectDocument", "asked"), ("BisectDocument", "told"), ("RepairDocument", "told"), ("Status", "FOUND"),
        ("Manifest", "made"), ("SearchResult", "asked"),
    }
)  # fmt: skip
"""Fields that are keys of a document, or of what authors' pages read."""

APART = {"vendored", "fakes", "standins", "peers"}
"""Folders apart: a vendored library and tiny packages are not ours to name."""


def files() -> Iterator[Path]:
    """Yield the files that the rule holds for: not the bodies of tests, whose names live for ten lines."""
    for folder in ("harness", "matrices/modules", "benchmarks", "docs", "tests"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not APART & {*path.parts} and not path.name.startswith("test_"):
                yield path


@pytest.mark.parametrize("path", list(files()), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_names_are_things_or_actions(path: Path) -> None:
    """Functions, classes, arguments and variables; inside a comprehension a short `one` is fine."""
    assert [name for name in _names(ast.parse(path.read_text(encoding="utf-8")), "") if _is_forbidden(*name)] == []


def modules_of_tests() -> Iterator[Path]:
    """Yield the files of tests."""
    yield from (path for path in sorted((ROOT / "tests").rglob("test_*.py")) if not APART & {*path.parts})


RIDDLE = re.compile(
    r"test_(what|whatever|which|who|whom|whose|where|when|why|how|that|whether)_"
    r"|.*_(told|said|foretold|anew|mend|mends|mended|thereof)(_|$)"
)
"""A test is named after a behaviour: a subject, a verb of today, an object."""


@pytest.mark.parametrize("path", list(modules_of_tests()), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_names_of_tests_say_a_behaviour(path: Path) -> None:
    """A test is no riddle, and a helper beside it is a thing or an action; names inside a test live for ten lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    owners = [tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))]
    defined = [node.name for owner in owners for node in owner.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    assert [name for name in defined if RIDDLE.match(name) or _is_forbidden("", name)] == []


def _is_forbidden(owner: str, name: str) -> bool:
    return name.strip("_").lower() in FORBIDDEN and (owner, name) not in FORMAT


def _names(node: ast.AST, owner: str) -> Iterator[tuple[str, str]]:
    """Yield every name that is bound, with the class that it is an attribute of."""
    for child in ast.iter_child_nodes(node):
        match child:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield owner, name
                yield from _names(child, "")
            case ast.ClassDef(name=name):
                yield owner, name
                yield from _names(child, name)
            case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()):
                yield owner, name
            case ast.ListComp() | ast.SetComp() | ast.DictComp() | ast.GeneratorExp() | ast.Lambda():
                pass
            case _:
                yield from _names(child, owner)

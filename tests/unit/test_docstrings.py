"""Hold docstrings to plain English: the first line says what is done, and is no riddle about what comes of it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RIDDLE = re.compile(r"\W*(What|Whether|Where|Which|Who|Whose|How|When|That|Why)\b")
APART = {"fakes", "vendored"}
FOLDERS = ("harness", "tests", "benchmarks", "docs", "matrices/modules")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py")) if not APART & {*path.parts}]
OWNERS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Module)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_docstring_begins_as_a_riddle(path: Path) -> None:
    """Each begins with a verb or with a thing."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, OWNERS)]
    texts = [text for node in nodes if (text := ast.get_docstring(node))]
    assert [text.splitlines()[0] for text in texts if RIDDLE.match(text)] == []

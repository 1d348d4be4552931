"""Hold tests to the doors of the harness: no test imports, reads or replaces a private name of it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
APART = {"fakes", "standins"}
"""Folders of packages under test, which are nobody's tests."""

EXCUSED = {
    "_exit": "`os._exit` ends a process without its last words",
    "_replace": "the public method of every NamedTuple",
    "_actions": "argparse lists the options of a parser nowhere else",
}
"""Names that only look private, by their reasons; none is of the harness."""

MODULES = {
    path.stem
    for path in (ROOT / "harness").rglob("*.py")
    if not {"incell", "vendored"} & {*path.parts} and not path.stem.startswith("_")
}
IN_TEXT = re.compile(rf"\b(?:{'|'.join(sorted(MODULES))})\._[a-z]\w*")
"""A private name in a program that a test writes and runs."""

REPLACING = {"setattr", "getattr", "delattr", "hasattr"}

FILES = [
    path
    for path in sorted((ROOT / "tests").rglob("*.py"))
    if not APART & {*path.parts} and path.name != "test_private_names.py"
]


def is_private(name: str) -> bool:
    """Return whether a name is for its own module or class alone."""
    return name.startswith("_") and not name.endswith("__") and name not in EXCUSED


def private_names(tree: ast.AST) -> Iterator[str]:
    """Yield the private names of others in a syntax tree: imported, read, replaced, or in a text that is run."""
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=value, attr=name) if is_private(name):
                if ast.unparse(value) not in {"self", "cls"}:
                    yield ast.unparse(node)
            case ast.ImportFrom(module=str(module), names=names) if module.partition(".")[0] == "harness":
                imported = [*module.split("."), *(alias.name for alias in names)]
                yield from (f"{module}: {name}" for name in imported if is_private(name))
            case ast.Call(func=ast.Attribute(attr=called) | ast.Name(id=called), args=words) if called in REPLACING:
                texts = [word.value for word in words if isinstance(word, ast.Constant) and isinstance(word.value, str)]
                yield from (text for text in texts if is_private(text.rpartition(".")[2]))
            case ast.Constant(value=str(text)):
                yield from IN_TEXT.findall(text)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT / "tests").as_posix())
def test_a_test_goes_through_the_doors(path: Path) -> None:
    """Everything that a test needs of a module is public, so the inside can change without its tests."""
    assert sorted(private_names(ast.parse(path.read_text(encoding="utf-8")))) == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from harness.machine.process import _live", ["harness.machine.process: _live"]),
        ("process._live.clear()", ["process._live"]),
        ("running._supervisor.pid", ["running._supervisor"]),
        ("monkeypatch.setattr(process, '_live', set())", ["_live"]),
        (
            "monkeypatch.setattr('harness.machine.process._live', set())",
            ["harness.machine.process._live", "process._live"],
        ),
        ("SCRIPT = 'while not process._live: pass'", ["process._live"]),
        ("self._live = cls._live\nprocess.__doc__\nos._exit(3)", []),
    ],
    ids=["imported", "read", "of an object", "replaced", "replaced by its path", "in a program", "one's own"],
)
def test_a_private_name_is_seen(text: str, found: list[str]) -> None:
    """A private name is found in every form in which a test can use it."""
    assert sorted(private_names(ast.parse(text))) == found

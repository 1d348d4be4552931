"""Typed values are made by many threads; by msgspec alone these rounds crash the process, each time they were tried."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import msgspec
import pytest

import harness
from harness.model import decoding

THREADS, ROUNDS, DEPTH = 4, 60, 9


@pytest.fixture
def restless() -> Iterator[None]:
    """Let threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def nested(number: int) -> tuple[list[type[msgspec.Struct]], list[Any]]:
    """Return types of which each holds those before it, and a plain value of each."""
    kinds: list[type[msgspec.Struct]] = []
    plains: list[Any] = []
    for level in range(DEPTH):
        held = range(max(0, level - 3), level)
        fields = [("own", int), *((f"of_{each}", kinds[each]) for each in held)]
        kinds.append(msgspec.defstruct(f"Kind{number}_{level}", fields))
        plains.append({"own": level, **{f"of_{each}": plains[each] for each in held}})
    return kinds, plains


@pytest.mark.usefixtures("restless")
def test_threads_that_meet_a_type_for_the_first_time() -> None:
    """Each thread gets its whole value, however the types hold each other."""
    with ThreadPoolExecutor(THREADS) as pool:
        for number in range(ROUNDS):
            kinds, plains = nested(number)
            barrier = Barrier(THREADS)

            def read(level: int, kinds: Any = kinds, plains: Any = plains, barrier: Barrier = barrier) -> Any:
                barrier.wait()
                if level % 2:
                    return decoding.convert(plains[level], kinds[level])
                return decoding.decoder(kinds[level]).decode(msgspec.json.encode(plains[level]))

            levels = range(DEPTH - THREADS, DEPTH)
            assert [msgspec.to_builtins(value) for value in pool.map(read, levels)] == plains[-THREADS:]


def test_each_type_has_one_decoder() -> None:
    """Also a union, and a type of the standard library."""
    for kind in (int | str, dict[str, int]):
        assert decoding.decoder(kind) is decoding.decoder(kind)  # type: ignore[arg-type]


def test_nothing_else_lets_msgspec_look_at_types() -> None:
    """A decoder, a conversion or `type=` anywhere else would be seen by no lock."""
    root = Path(harness.__file__).parent
    others = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path in sorted(root.rglob("*.py"))
        if path != Path(decoding.__file__) and "msgspec" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if looks_at_types(node)
    ]
    assert others == []


def looks_at_types(node: ast.AST) -> bool:
    """Return whether code makes a decoder, converts, decodes to a type, or imports what does."""
    if isinstance(node, ast.ImportFrom):
        return bool(node.module == "msgspec" and {"convert", "json"} & {alias.name for alias in node.names})
    text = ast.unparse(node) if isinstance(node, ast.Call) else ""
    typed = isinstance(node, ast.Call) and any(keyword.arg == "type" for keyword in node.keywords)
    return text.startswith(("msgspec.convert(", "msgspec.json.Decoder(")) or (
        text.startswith("msgspec.json.decode(") and typed
    )

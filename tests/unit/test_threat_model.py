"""The threat model promises nothing without a test, and every fault that is only documented stands in it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from benchmarks import faults

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "threat-model.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)))


@pytest.mark.parametrize(("file", "test"), NAMED, ids=lambda name: str(name).rpartition("/")[2])
def test_every_test_that_is_named_exists(file: str, test: str) -> None:
    """The file has a test of that name."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))

    assert test in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_every_promise_names_a_test() -> None:
    """Each row of a table of promises ends with a test."""
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith(("| it cannot", "| ---", "| sandbox", "| `"))]

    assert len(promises) > 20
    assert [row for row in promises if "`tests/" not in row] == []


def test_documented_faults_have_a_heading_of_the_page() -> None:
    """A fault that no mechanism can hold names a heading of the page."""
    headings = set(re.findall(r"(?m)^#+ (.+)$", PAGE))

    assert {fault.documented for fault in faults.load_faults() if fault.documented} <= headings

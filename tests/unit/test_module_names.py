"""Test modules: no two have one name, since pytest imports them by name alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]


def test_no_two_test_modules_share_a_name() -> None:
    """Collection would stop at the second one."""
    names = Counter(path.name for path in TESTS.rglob("test_*.py") if "fakes" not in path.parts)

    assert [name for name, count in names.items() if count > 1] == []

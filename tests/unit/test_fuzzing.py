"""A seeded sample of mutated inputs; `nox -s endurance` tries a hundred thousand."""

from __future__ import annotations

from pathlib import Path

import matplotlib.font_manager  # noqa: F401 - its first import in a home makes a folder there
import pytest
from fuzzing.driving import fuzz
from fuzzing.targets import TARGETS

COUNTS = {
    "matrix files": 60,
    "requirement files": 300,
    "reports": 40,
    "merged reports": 20,
    "sites": 6,
    "command lines": 120,
}


@pytest.mark.parametrize("name", TARGETS)
def test_no_input_is_more_than_refused(tmp_path: Path, name: str) -> None:
    """No traceback, no exit with 4, no end later than ten seconds, no write outside, no process."""
    found = fuzz(TARGETS[name], COUNTS[name], tmp_path / "work")
    assert not found.broken, "\n".join(found.broken)
    assert found.count == COUNTS[name]

"""A seeded sample of mutated replies, frames, metadata and records; `nox -s endurance` tries the full count."""

from __future__ import annotations

from pathlib import Path

import pytest
from fuzzing.cell_targets import CELL_TARGETS
from fuzzing.driving import fuzz

COUNTS = {"replies": 400, "frames": 400, "metadata": 300, "stored records": 200}


@pytest.mark.parametrize("name", CELL_TARGETS)
def test_nothing_that_a_cell_leaves_is_more_than_refused(tmp_path: Path, name: str) -> None:
    """No exception but the one for hostile data, no end later than ten seconds, no write outside."""
    found = fuzz(CELL_TARGETS[name], COUNTS[name], tmp_path / "work")
    assert not found.broken, "\n".join(found.broken)
    assert found.codes[0] > COUNTS[name] // 50
    assert found.codes[2] > COUNTS[name] // 50

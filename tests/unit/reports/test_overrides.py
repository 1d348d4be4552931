"""Measured cells that work against a requirement of a package in them."""

from __future__ import annotations

from harness.reports.answers import measured_cells, result_index
from harness.reports.explanations import overrides


def test_cells_that_work_against_a_requirement_are_collected() -> None:
    """gym 0.18.0 asks for pillow<=7.2.0, and its cell of drift-classic ran with pillow 9.5.0."""
    pairs = overrides.working_overrides(measured_cells.read(result_index.load_shipped()))
    assert [
        pair["cell"] for pair in pairs if (pair["asker"], pair["version"], pair["held"]) == ("gym", "0.18.0", "9.5.0")
    ]
    assert all({*pair} == {"asker", "version", "package", "held", "cell"} for pair in pairs)

"""The committed reports against combinations that were measured by hand."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "real"))
import agreement


def test_the_reports_agree_with_what_was_measured_by_hand() -> None:
    """The first failing phase is right in 97 of 100, and no `works` is wrong."""
    compared = list(agreement.reported())

    assert len(compared) >= 150
    assert [one for one in compared if one.wrong_works] == []
    assert agreement.good(compared)
    assert (Path(agreement.HERE) / "agreement.md").read_text().splitlines()[2] == agreement.sum_up(compared)

"""Test the plugin that pytest loads wherever simmatrix is installed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from harness.machine import capacity
from harness.smoke import plugin


@dataclass
class Options:
    """The options of a session."""

    matrix: tuple[str, ...]

    def getoption(self, name: str) -> Any:
        return getattr(self, name)


@pytest.mark.parametrize(
    ("free_mb", "cores", "workers"),
    [(24_000, 4, 4), (5_000, 4, 2), (100, 4, 1), (None, 4, 4), (24_000, 1, 1)],
)
def test_auto_is_bounded_by_cores_and_free_memory(
    free_mb: int | None, cores: int, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`-n auto` leaves room for one probe per worker, and starts one at least."""
    monkeypatch.setattr(capacity, "free_mb", lambda: free_mb)
    monkeypatch.setattr(capacity, "default_jobs", lambda: cores)

    assert plugin.pytest_xdist_auto_num_workers(Options(("m",))) == workers  # type: ignore[arg-type]


def test_auto_is_xdists_own_without_a_matrix() -> None:
    """A session of somebody else's is left alone."""
    assert plugin.pytest_xdist_auto_num_workers(Options(())) is None  # type: ignore[arg-type]

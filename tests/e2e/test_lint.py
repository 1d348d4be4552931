"""The rules of the code hold: types, style, sizes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(("mypy",), id="mypy-strict"),
        pytest.param(("ruff", "check"), id="ruff-with-size-rules"),
        pytest.param(("ruff", "format", "--check"), id="ruff-format"),
    ],
)
def test_rule(command: tuple[str, ...]) -> None:
    """The tool finds nothing."""
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout + done.stderr

"""Every benchmark can still be started: its imports exist, and its arguments are read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STARTED = sorted(
    path.relative_to(ROOT)
    for path in (ROOT / "benchmarks").rglob("*.py")
    if path.name == "__main__.py" or 'if __name__ == "__main__":' in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("script", STARTED, ids=str)
def test_a_benchmark_starts(script: Path) -> None:
    """A benchmark prints its help with code 0, after all of its module was run."""
    package = script.name == "__main__.py"
    command = ("-m", ".".join(script.parent.parts)) if package else (str(script),)
    ran = subprocess.run(
        (sys.executable, *command, "--help"), cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.startswith("usage: ")


def test_peers_are_asked_what_a_cell_is_asked() -> None:
    """The other tools run exactly the checks of one of our cases."""
    code = "import peers; print(*peers.REQUESTS['checks'])"
    ran = subprocess.run(
        (sys.executable, "-c", code), cwd=ROOT / "benchmarks", capture_output=True, text=True, timeout=60, check=True
    )
    assert ran.stdout.split() == [
        "import.modules",
        "single.loop",
        "vector.sync",
        "vector.async.fork",
        "render.rgb_array",
    ]

"""A sample of the declared faults, really caused: no run is lost, and no fault is blamed on something else."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import faults

TABLE = faults.ROOT / "reports" / "faults" / "faults.json"
QUICK, COUNT, SEED = 15.0, 9, 15


def sample() -> list[str]:
    """Choose the same quick faults each time, always with one whose folder is a full disk."""
    rows = json.loads(TABLE.read_text(encoding="utf-8"))["faults"]
    quick = sorted(row["fault"] for row in rows if row["tried"] and row["held"] and row["seconds"] < QUICK)
    return ["machine.full_state_table", *random.Random(SEED).sample(quick, min(COUNT, len(quick)))]


@pytest.mark.parametrize("fault", sample())
def test_the_promise_of_a_fault_holds(fault: str, wheels: Path, tmp_path: Path) -> None:
    """A fault has the result that the table promises."""
    command = (sys.executable, "-m", "benchmarks.faults", "-k", fault, "-j", "1", "--fresh")
    ran = subprocess.run(
        (*command, "--wheels", str(wheels), "--folder", str(tmp_path)),
        cwd=faults.ROOT,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    if "not tried: needs" in ran.stderr:
        pytest.skip(f"unavailable: {ran.stderr.partition('not tried: needs ')[2].strip()}")
    assert ran.returncode == 0, ran.stderr

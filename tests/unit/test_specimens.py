"""Tests that the data of the unit tests are what the harness itself writes."""

from __future__ import annotations

import json
from pathlib import Path

from builders import HERE, LLVMPIPE, MACHINES
from specimens import GPU

from harness.machine import this_machine

QUICKSTART = Path(__file__).parents[2] / "reports" / "quickstart" / "report.json"


def test_specimens_of_machines_have_names_that_were_measured() -> None:
    """No fact has a name that no measured machine has."""
    (measured,) = json.loads(QUICKSTART.read_text(encoding="utf-8"))["machines"].values()

    assert MACHINES[HERE].keys() <= measured.keys()
    assert LLVMPIPE.keys() <= measured["egl"].keys()
    assert MACHINES[HERE]["gpu"] == measured["gpu"]


def test_the_specimen_of_a_gpu_is_what_its_driver_says(tmp_path: Path) -> None:
    """The files of NVIDIA's driver are read under the names of the specimen."""
    card = tmp_path / "proc/driver/nvidia/gpus/0000:01:00.0"
    card.mkdir(parents=True)
    (card / "information").write_text("Model: \t\t NVIDIA H200\nIRQ: 1\n")
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/nvidia0").touch()
    (tmp_path / "proc/driver/nvidia/version").write_text("NVRM version: NVIDIA UNIX  570.86.15  Tue\n")

    assert this_machine.find_gpus(tmp_path) == (GPU, True)

"""Tests that the data of the unit tests are what the harness itself writes."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import pytest
from builders import HERE, LLVMPIPE, MACHINES, measured_case, measured_cell
from facts import distribution, facts
from readings import FAILED, SKIPPED, Check, lines
from specimens import GPU

from harness.machine import this_machine
from harness.probes import wire
from harness.standalone import doctor

DESCRIBING = Path(doctor.__file__).parent / "describe_environment.py"
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


def test_the_specimen_of_a_machine_is_one_that_can_be_named() -> None:
    """The machine's own label of the specimen's parts names the driver that the specimen has."""
    assert this_machine.label(MACHINES[HERE]) == "mesa22.3"


def test_specimens_of_measured_cells_have_no_invented_field() -> None:
    """A measured cell of the tests is of the type that the shipped results have, and so is its case."""
    with pytest.raises(KeyError, match="invented"):
        measured_cell("x", invented=1)
    with pytest.raises(KeyError, match="invented"):
        measured_case("x", invented=1)


def test_specimens_of_environments_are_what_the_doctor_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments of the tests have the keys of this one, looked at by the doctor's own script."""
    monkeypatch.setattr(sys, "path", [*sys.path])  # the script takes from it all that is not Python's own
    written = runpy.run_path(str(DESCRIBING))["document"]()

    assert facts().keys() == written.keys()
    assert facts()["python"].keys() <= written["python"].keys()
    assert distribution("numpy", "2.2.6").keys() == written["distributions"][0].keys()


def test_specimens_of_replies_are_read_without_a_complaint() -> None:
    """The lines of a stored reply are those that a cell writes."""
    checks = [
        Check(name="single.loop", findings=("odd",)),
        Check(name="single.space", outcome=FAILED, message="boom"),
        Check(name="single.state", outcome=SKIPPED),
    ]
    reply = wire.read_reply(lines(checks).splitlines(keepends=True), {})

    assert (reply.problems, reply.complete) == ((), True)
    assert [str(check.outcome) for check in reply.checks] == ["passed", "failed", "skipped"]

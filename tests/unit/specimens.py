"""A whole matrix with a cell of every kind, its records and its report; and how golden files are compared."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from builders import GENERATED, HERE, MACHINES, case, cell, phase, record, step, warning

from harness.model import (
    CaseRecord,
    Cell,
    CellRecord,
    Dropped,
    Edit,
    Expectation,
    Outcome,
    Phase,
    Plan,
    Repair,
    Verdict,
    cellid,
    replace,
)
from harness.model.report_types import CellEntry, Document
from harness.reports import document

GPU = {"models": "NVIDIA H200", "driver": "570.86.15"}
"""Facts of a machine that has a GPU, under the names that `harness.machine.this_machine` writes."""
SOLVER = "AttributeError: 'mujoco._structs.MjData' object has no attribute 'solver_iter'"
XML = "ValueError: XML Error: bad | worse / Element 'default', line 0"
RESET = "ConnectionResetError: [Errno 104] Connection reset by peer"
EXPECTED = Expectation(
    verdict=Verdict.PARTIAL,
    phase=Phase.RENDER,
    match="solver_iter",
    reason="gymnasium 0.29 reads a field that mujoco 3.0 renamed",
    link="https://example.org/749",
)


def combination(python: str, gymnasium: str, mujoco: str, expect: Expectation | None = None) -> Cell:
    """Return a cell of the matrix `quick`."""
    return cell(
        f"py{python}_gymnasium-{gymnasium}_mujoco-{mujoco}",
        ("cartpole", "ant"),
        axes={"python": python, "gymnasium": gymnasium, "mujoco": mujoco},
        python=python,
        expect=expect,
    )


def quick_record(of: Cell, ant: CaseRecord, **more: Any) -> CellRecord:
    """Return a record of a cell of `quick`, with CartPole working and Ant as given."""
    cartpole = replace(case("pppp", "cartpole"), env="CartPole-v1")
    installed = {"gymnasium": of.axes["gymnasium"], "mujoco": of.axes["mujoco"], "numpy": "2.2.6"}
    full = {"3.9": "3.9.18", "3.11": "3.11.7"}[of.python]
    return record(cartpole, ant, of=of, python=full, installed=installed, lock="locks/5f0c.txt", **more)


REPAIR = Repair(
    name="gymnasium",
    version="0.29.1",
    uploaded="2023-08-21T00:00:00Z",
    origin="1" * 64,
    wheel="2" * 64,
    build=("setuptools==66.1.1",),
    python=">=3.8",
    edits=(Edit(field="Requires-Dist", old="shimmy (>=1.)", new="shimmy (>=1)"),),
    reason="an extra requires what is no version",
    link="https://example.org/750",
)


def quick() -> tuple[Plan, tuple[CellRecord, ...]]:
    """Return a small matrix: green, red as expected, red in other ways, unavailable, not run, left out."""
    complaint = warning("single.check_env", "the render mode 'depth_array' does not work")
    complained = phase(Phase.SINGLE, Outcome.PASSED, findings=(complaint,))
    field_gone = case("pppf", render=phase(Phase.RENDER, Outcome.FAILED, SOLVER))
    cells = (
        combination("3.9", "0.29.1", "2.3.7"),
        combination("3.9", "0.29.1", "3.3.7", EXPECTED),
        combination("3.11", "0.29.1", "3.3.7"),
        combination("3.11", "1.2.3", "2.3.7"),
        combination("3.11", "1.2.3", "3.3.7"),
        combination("3.13", "1.2.3", "3.3.7"),
        combination("3.13", "1.2.3", "2.3.7"),
        combination("3.11", "0.29.1", "1.50"),
    )
    records = (
        quick_record(cells[0], case("pppp", single=complained), repairs=(REPAIR,)),
        quick_record(cells[1], field_gone),
        quick_record(cells[2], field_gone),
        quick_record(cells[3], case("ppfp", vector=phase(Phase.VECTOR, Outcome.FAILED, XML, masked_by=RESET))),
        quick_record(
            cells[4], case("pppu", single=complained, render=phase(Phase.RENDER, Outcome.UNAVAILABLE, "no EGL"))
        ),
        CellRecord(cell=cells[5], machine=HERE, unavailable="no Python 3.13 here", measured="2026-11-21T12:00:00Z"),
        CellRecord(
            cell=cells[7],
            machine=HERE,
            python="3.11.7",
            resolve=step(Phase.RESOLVE, Outcome.FAILED, "Because there is no mujoco==1.50"),
            measured="2026-11-21T12:00:00Z",
            seconds=0.4,
        ),
    )
    dropped = tuple(
        Dropped(id=f"quick/py3.9_gymnasium-1.2.3_mujoco-{mujoco}", reason="gymnasium 1.2 needs Python 3.10")
        for mujoco in ("2.3.7", "3.3.7")
    )
    axes = ("python", "gymnasium", "mujoco")
    return Plan(matrix="quick", cells=cells, dropped=dropped, axes=axes, shown=("numpy",)), records


def quick_document() -> Document:
    """Return the report document of `quick`."""
    plan, records = quick()
    return document.build(records, [plan], MACHINES, GENERATED)


def moved(number: int, axes: Mapping[str, str], **more: Any) -> CellEntry:
    """Return an entry of the document of `quick` with other axes, and with `more` in place of its values."""
    parts = (f"py{value}" if name == "python" else cellid.package(name, value) for name, value in axes.items())
    values = {"id": str(cellid.CellId.build("quick", parts)), "axes": axes, "requested_python": axes["python"], **more}
    return msgspec.structs.replace(quick_document().cells[number], **values)


def check_golden(name: str, text: str, folder: Path) -> None:
    """Compare with the golden file of this name; what to type to accept the change is part of the failure."""
    golden = Path(__file__).parent / "golden" / name
    actual = folder / name
    actual.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8"), f"to accept: cp {actual} {golden}"

"""Small real records to judge, tabulate and present."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness import document, schema
from harness.judging.known_failures import Knowledge
from harness.model import (
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    CheckRecord,
    Dropped,
    Edit,
    Expectation,
    Finding,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    Plan,
    Question,
    Repair,
    Step,
    Verdict,
)
from harness.reporttypes import Document
from harness.signatures import Signature

CHECKS = {
    Phase.IMPORT: "import.modules",
    Phase.SINGLE: "single.loop",
    Phase.VECTOR: "vector.sync",
    Phase.RENDER: "render.rgb_array",
}
"""A check of each phase that every case goes through."""
LETTERS = {
    "p": Outcome.PASSED,
    "f": Outcome.FAILED,
    "c": Outcome.CRASHED,
    "t": Outcome.TIMED_OUT,
    "y": Outcome.FLAKY,
    "i": Outcome.INFRA,
    "u": Outcome.UNAVAILABLE,
    "n": Outcome.NOT_REACHED,
    "s": Outcome.SKIPPED,
}


def step(phase: Phase, outcome: Outcome = Outcome.PASSED, decisive: str | None = None) -> Step:
    """A step on the host."""
    return Step(phase=phase, outcome=outcome, decisive=decisive, log=f"evidence/{phase}/log.txt")


def phase(
    name: Phase, outcome: Outcome, decisive: str | None = None, findings: tuple[Finding, ...] = (), **more: Any
) -> PhaseRecord:
    """A phase with one check that ended as the phase did, as a probe leaves it."""
    check = CheckRecord(check=CHECKS[name], outcome=outcome, decisive=decisive, masked_by=more.pop("masked_by", None))
    ran = outcome is not Outcome.NOT_REACHED
    return PhaseRecord(
        phase=name, outcome=outcome, decisive=decisive, checks=(check,) if ran else (), findings=findings, **more
    )


def case(outcomes: str, name: str = "ant", required: tuple[str, ...] = (), **replaced: PhaseRecord) -> CaseRecord:
    """A case from one letter per phase: `ppfn` is import and single passed, vector failed, render not reached."""
    phases = {
        at.value: phase(at, LETTERS[letter], f"{name} {at}" if letter in "fctyiu" else None)
        for at, letter in zip(CHECKS, outcomes, strict=True)
    }
    return CaseRecord(
        case=name, env="Ant-v5", api="gymnasium", required=required, phases=tuple((phases | replaced).values())
    )


def cell(label: str = "py3.11_gymnasium-1.2.3", cases: Iterable[str] = ("ant",), **more: Any) -> Cell:
    """A cell of the matrix `quick`, with a case of every phase for each name."""
    values: dict[str, Any] = {
        "id": f"quick/{label}",
        "matrix": "quick",
        "axes": {"python": "3.11", "gymnasium": "1.2.3"},
        "python": "3.11",
        "question": Question(requirements=("gymnasium==1.2.3",)),
        "environment": {},
        "cases": tuple(Case(id=name, env="Ant-v5", api="gymnasium", checks=tuple(CHECKS.values())) for name in cases),
    }
    return Cell(**(values | more))


def record(*cases: CaseRecord, of: Cell | None = None, **more: Any) -> CellRecord:
    """An installed cell with these cases."""
    values: dict[str, Any] = {
        "cell": of or cell(cases=[tried.case for tried in cases]),
        "machine": "linux-x86_64",
        "python": "3.11.7",
        "installed": {"gymnasium": "1.2.3", "numpy": "2.2.6"},
        "resolve": step(Phase.RESOLVE),
        "install": step(Phase.INSTALL),
        "cases": cases,
        "measured": "2026-11-21T12:00:00Z",
        "seconds": 12.34,
    }
    return CellRecord(**(values | more))


def signature(name: str, pattern: str | None = "solver_iter", **more: Any) -> Signature:
    """A known failure with this pattern, in any phase, and whatever else its file says."""
    plain = {"id": name, "cause": "because", "remedy": {}, "pattern": pattern}
    return schema.load_json(json.dumps(plain | more), Signature, name)


def knowing(*signatures: Signature, **logs: Mapping[str, str]) -> Knowledge:
    """Knowledge of these, with texts kept at paths whose last part is the name."""
    return Knowledge(signatures=lambda: signatures, logs=lambda path: logs.get(Path(path).name, {}))


def warning(check: str, text: str = "the same seed gives another trajectory") -> Finding:
    """A finding that a matrix can require not to be there."""
    return Finding(check=check, level=Level.WARNING, text=text)


def plain(judgement: Mapping[Phase, Outcome]) -> dict[str, str]:
    """Phases and outcomes as words."""
    return {at.value: outcome.value for at, outcome in judgement.items()}


# --- a whole matrix, with a cell of every kind -----------------------------------------------------------------

HERE = "linux-x86_64"
LLVMPIPE = {"vendor": "Mesa/X.org", "renderer": "llvmpipe", "version": "4.5 Mesa 22.3.6"}
MACHINES = {
    HERE: {
        "os": "Debian 12",
        "libc": "glibc 2.36",
        "architecture": "x86_64",
        "egl": LLVMPIPE,
        "osmesa": {"missing": "no library"},
        "gpu": {"missing": "no driver of NVIDIA's"},
    }
}
"""Facts under the names that `harness.machine` writes: a test compares them with those of a committed report."""
GPU = {"models": "NVIDIA H200", "driver": "570.86.15"}
"""The same of a machine that has one."""
GENERATED = "2026-11-21T12:30:00Z"
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
    """A cell of the matrix `quick`."""
    return cell(
        f"py{python}_gymnasium-{gymnasium}_mujoco-{mujoco}",
        ("cartpole", "ant"),
        axes={"python": python, "gymnasium": gymnasium, "mujoco": mujoco},
        python=python,
        expect=expect,
    )


def measured(of: Cell, ant: CaseRecord, **more: Any) -> CellRecord:
    """A record of a cell of `quick`, with CartPole working and Ant as given."""
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
    """A small matrix: green, red as expected, red in other ways, unavailable, not run, left out."""
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
        measured(cells[0], case("pppp", single=complained), repairs=(REPAIR,)),
        measured(cells[1], field_gone),
        measured(cells[2], field_gone),
        measured(cells[3], case("ppfp", vector=phase(Phase.VECTOR, Outcome.FAILED, XML, masked_by=RESET))),
        measured(cells[4], case("pppu", single=complained, render=phase(Phase.RENDER, Outcome.UNAVAILABLE, "no EGL"))),
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
    """The report document of `quick`."""
    plan, records = quick()
    return document.build(records, [plan], MACHINES, GENERATED)


def agrees(name: str, text: str, folder: Path) -> None:
    """Compare with the golden file of this name; what to type to accept the change is part of the failure."""
    golden = Path(__file__).parent / "golden" / name
    actual = folder / name
    actual.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8"), f"to accept: cp {actual} {golden}"

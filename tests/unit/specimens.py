"""Small real records to judge, tabulate and present."""

from collections.abc import Iterable, Mapping
from typing import Any

from harness.model import (
    CASE_PHASES,
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    CheckRecord,
    Finding,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Step,
)

CHECKS = {
    Phase.IMPORT: "import.modules",
    Phase.SINGLE: "single.loop",
    Phase.VECTOR: "vector.sync",
    Phase.RENDER: "render.rgb_array",
}
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
        for at, letter in zip(CASE_PHASES, outcomes, strict=True)
    }
    return CaseRecord(
        case=name, env="Ant-v5", api="gymnasium", required=required, phases=tuple((phases | replaced).values())
    )


def cell(label: str = "py3.11-gymnasium1.2.3", cases: Iterable[str] = ("ant",), **more: Any) -> Cell:
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


def warning(check: str, text: str = "the same seed gives another trajectory") -> Finding:
    """A finding that a matrix can require not to be there."""
    return Finding(check=check, level=Level.WARNING, text=text)


def plain(judgement: Mapping[Phase, Outcome]) -> dict[str, str]:
    """Phases and outcomes as words."""
    return {at.value: outcome.value for at, outcome in judgement.items()}

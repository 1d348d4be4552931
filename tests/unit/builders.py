"""Builders of what tests are about: small values of the real types, with all that a test does not name filled in."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from harness.judging.known_failures import NOTHING_KNOWN, Knowledge
from harness.matrix import matrix_file, plan
from harness.matrix.matrix_types import Matrix
from harness.matrix.signatures import Signature
from harness.model import (
    Artifact,
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    CheckRecord,
    Finding,
    Interpreter,
    Level,
    Lock,
    Outcome,
    Phase,
    PhaseRecord,
    Pin,
    Plan,
    Question,
    Step,
    schema,
)
from harness.model.measured import MeasuredCell
from harness.model.report_types import CaseEntry, CellEntry, DiagnosisEntry, Document
from harness.reports import document
from harness.reports.answers import digest
from harness.standalone.failures import matching

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
"""Facts under the names that `this_machine` writes: a test compares them with those of a committed report."""
GENERATED = "2026-11-21T12:30:00Z"
SHA = "0" * 64
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


# --- a cell, and what was measured of it -----------------------------------------------------------------------


def step(phase: Phase, outcome: Outcome = Outcome.PASSED, decisive: str | None = None) -> Step:
    """Return a step on the host."""
    return Step(phase=phase, outcome=outcome, decisive=decisive, log=f"evidence/{phase}/log.txt")


def phase(
    name: Phase, outcome: Outcome, decisive: str | None = None, findings: tuple[Finding, ...] = (), **more: Any
) -> PhaseRecord:
    """Return a phase with one check that ended as the phase did, as a probe leaves it."""
    check = CheckRecord(check=CHECKS[name], outcome=outcome, decisive=decisive, masked_by=more.pop("masked_by", None))
    ran = outcome is not Outcome.NOT_REACHED
    return PhaseRecord(
        phase=name, outcome=outcome, decisive=decisive, checks=(check,) if ran else (), findings=findings, **more
    )


def phase_of_checks(**ended: Outcome) -> PhaseRecord:
    """A phase of several checks, each with a line of its own: `vector_async_fork` is the check `vector.async.fork`.

    It ended as the first of them that did not pass.
    """
    checks = tuple(
        CheckRecord(check=name.replace("_", "."), outcome=outcome, decisive=f"own line of {name.replace('_', '.')}")
        for name, outcome in ended.items()
    )
    first = next((check for check in checks if check.outcome is not Outcome.PASSED), checks[0])
    return PhaseRecord(
        phase=Phase(first.check.partition(".")[0]), outcome=first.outcome, decisive=first.decisive, checks=checks
    )


def render_phase(camera: Outcome | None, line: str = "looks elsewhere", **facts: Any) -> PhaseRecord:
    """Return a render phase with a picture that has these facts, and the outcome of its camera check, if it ran."""
    checks = [CheckRecord(check="render.rgb_array", outcome=Outcome.PASSED, facts=facts)]
    checks += [CheckRecord(check="render.camera", outcome=camera, decisive=line)] if camera else []
    return PhaseRecord(phase=Phase.RENDER, outcome=Outcome.PASSED, checks=tuple(checks))


def case(outcomes: str, name: str = "ant", required: tuple[str, ...] = (), **replaced: PhaseRecord) -> CaseRecord:
    """Return a case from one letter per phase: in `ppfn` import and single passed, vector failed, render never ran."""
    phases = {
        at.value: phase(at, LETTERS[letter], f"{name} {at}" if letter in "fctyiu" else None)
        for at, letter in zip(CHECKS, outcomes, strict=True)
    }
    return CaseRecord(
        case=name, env="Ant-v5", api="gymnasium", required=required, phases=tuple((phases | replaced).values())
    )


def cell(label: str = "py3.11_gymnasium-1.2.3", cases: Iterable[str] = ("ant",), **more: Any) -> Cell:
    """Return a cell of the matrix `quick`, with a case of every phase for each name."""
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


def cell_requiring(*requirements: str, constraints: Iterable[str] = (), **more: Any) -> Cell:
    """Return a cell without cases that has these requirements and constraints."""
    question = Question(requirements=requirements, constraints=tuple(constraints))
    return cell(**({"cases": (), "axes": {}, "question": question} | more))


def record(*cases: CaseRecord, of: Cell | None = None, **more: Any) -> CellRecord:
    """Return the record of an installed cell with these cases."""
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
    """Return a finding that a matrix can forbid."""
    return Finding(check=check, level=Level.WARNING, text=text)


# --- what is known ---------------------------------------------------------------------------------------------


def signature(name: str, pattern: str | None = "solver_iter", **more: Any) -> Signature:
    """Return a known failure with this pattern, in any phase; `more` holds other keys of its file."""
    plain = {"id": name, "cause": "because", "remedy": {}, "pattern": pattern}
    return schema.load_json(json.dumps(plain | more), Signature, name)


def make_knowledge(*signatures: Signature, **logs: Mapping[str, str]) -> Knowledge:
    """Return knowledge of these signatures, with texts at paths whose last part is the name."""
    return Knowledge(signatures=lambda: signatures, logs=lambda path: logs.get(Path(path).name, {}))


def standalone_signature(name: str, pattern: str | None = "no wings", **more: Any) -> matching.Signature:
    """Return a known failure of `single` as the standalone code reads it."""
    plain = {"id": name, "cause": f"the cause of {name}", "remedy": {"text": "mend it"}, "phases": ["single"]}
    return matching.read({**plain, **({"pattern": pattern} if pattern else {}), **more})


def diagnosis(name: str, **more: Any) -> DiagnosisEntry:
    """Return a known failure as it stands in documents."""
    usual = {"cause": f"cause of {name}", "remedy": {}, "proven": False, "masks": False, "references": ()}
    return DiagnosisEntry(signature=name, **(usual | more))


# --- documents -------------------------------------------------------------------------------------------------


def document_of(*records: CellRecord, knowledge: Knowledge = NOTHING_KNOWN, **planned: Any) -> Document:
    """Return a document of these records; `planned` holds more fields of its plan."""
    cells = tuple({one.cell.id: one.cell for one in records}.values())
    quick = Plan(matrix="quick", cells=cells, **planned)
    machines = {one.machine: MACHINES[HERE] for one in records}
    return document.build(records, [quick], machines, GENERATED, knowledge=knowledge)


def entry(cell_record: CellRecord, knowledge: Knowledge = NOTHING_KNOWN, **planned: Any) -> CellEntry:
    """Return the entry of a record, in a document that holds only this record."""
    return document_of(cell_record, knowledge=knowledge, **planned).cells[0]


def plain(judgement: Mapping[Phase, Outcome]) -> dict[str, str]:
    """Return phases and outcomes as plain strings."""
    return {at.value: outcome.value for at, outcome in judgement.items()}


@cache
def _measured(letters: str) -> MeasuredCell:
    """Return the measured cell of a record whose one case ended as these letters say."""
    question = Question(requirements=())
    measured = record(case(letters, "c"), of=cell("c", ("c",), matrix="m", axes={}, question=question))
    return digest.from_report(document_of(measured), Path()).cells[0]


def measured_cell(name: str, verdict: str = "works", python: str = "3.11.7", **more: Any) -> MeasuredCell:
    """Return a cell of the matrix `m` as measured results hold it, with `more` in place of its values, as in JSON.

    It is made of a record. A red one failed in `single`, without a line. Raises KeyError for an invented key.
    """
    own = {"id": f"m/{name}", "python": python, "verdict": verdict, "decisive": None, **more}
    for key in own.keys() - set(MeasuredCell.__struct_fields__):
        raise KeyError(key)
    usual = msgspec.to_builtins(_measured("pppp" if verdict == "works" else "pfnn"))
    return msgspec.convert(usual | own, MeasuredCell)


def measured_case(case: str = "c", env: str = "Ant-v5", **more: Any) -> dict[str, Any]:
    """Return the JSON of a case of such a cell, with `more` in place of its values."""
    own = {"case": case, "env": env, **more}
    for key in own.keys() - set(CaseEntry.__struct_fields__):
        raise KeyError(key)
    usual: dict[str, Any] = msgspec.to_builtins(_measured("pppp").cases[0])
    return usual | own


# --- matrices --------------------------------------------------------------------------------------------------

CASE = '[[cases]]\nenv = "CartPole-v1"\napi = "gymnasium"\n'
"""A case as a matrix file has it."""


def matrix(text: str, path: str = "demo.toml") -> Matrix:
    """Return the matrix that a file with this text is."""
    return matrix_file.read(text, path)


def make_plan(of: str | Matrix, host: str = "3.12.1", **sources: Any) -> Plan:
    """Return the plan of a matrix, or of the text of one; `sources` are more of what it is made from."""
    read = matrix(of) if isinstance(of, str) else of
    return plan.make_plan(plan.Sources(matrix=read, host_python=host, **sources))


# --- interpreters and locks ------------------------------------------------------------------------------------


def interpreter(version: str = "3.11.7", implementation: str = "cpython") -> Interpreter:
    """Return an interpreter as `interpreters` describes it."""
    return Interpreter(path="/python", version=version, implementation=implementation, identity=version)


def pin(name: str, version: str, source: str = "x", filename: str = "x.whl") -> Pin:
    """Return a package of a lock."""
    artifact = Artifact(filename=filename, sha256=SHA, source=source)
    return Pin(name=name, version=version, artifact=artifact, hashes=(SHA,))


def lock(*pins: Pin, **more: Any) -> Lock:
    """Return a lock of these packages."""
    text = "".join(f"{one.name}=={one.version}\n" for one in pins)
    return Lock(**({"pins": pins, "requirements": text, "sha256": SHA, "instant": GENERATED} | more))

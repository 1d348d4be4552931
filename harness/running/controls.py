"""Read the controls: for each adapter a known-good lock with a case, from `matrices/controls/`.

A control that fails on a machine says that its adapter, or the machine, is at fault: what else fails with the adapter
there says nothing about packages. `HARNESS_CONTROLS` names another folder of them; set to the empty string, there are
none.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, field
from packaging.utils import canonicalize_name

from harness.judging.exercised import unregistered_id
from harness.machine.files import given_files
from harness.matrix.matrix_types import Table
from harness.model import (
    FAILING,
    Case,
    Cell,
    CellRecord,
    ControlRecord,
    Outcome,
    Phase,
    PhaseRecord,
    Question,
    Verdict,
    replace,
    schema,
)
from harness.model.errors import BadInput
from harness.model.vocabulary import (
    Api,
    CheckName,
    Instant,
    Label,
    Requirement,
    checks_of,
    parsed_requirement,
    required_name,
)
from harness.packages import locks

MATRIX = "controls"
"""What stands for a matrix in the ids of their cells."""

VARIABLE = "HARNESS_CONTROLS"
FILE = "controls.toml"


class ControlTable(Table, frozen=True, kw_only=True):
    """A known-good combination of one adapter; its lock is the file `ID.txt` beside this one."""

    id: Label
    api: Api
    covers: Annotated[
        Requirement | None, Meta(description="which cells it speaks for, by what they installed; default: all others")
    ] = None
    python: str
    requirements: Annotated[tuple[Requirement, ...], Meta(min_length=1, description="what the lock was made of")]
    build_constraints: tuple[Requirement, ...] = ()
    env: str
    kwargs: Annotated[dict[str, Any], Meta(description="arguments of make")] = field(default_factory=dict)
    checks: Annotated[tuple[CheckName, ...], Meta(description="as in a case of a matrix")] = ()
    timeouts: Annotated[dict[Phase, float], Meta(description="phase to seconds for each of its checks")] = field(
        default_factory=dict
    )
    reason: Annotated[str, Meta(description="why this one is known to be good, and what it stands for")]


class ControlsFile(Table, frozen=True, kw_only=True):
    """The file `controls.toml`. Of one adapter the first control that covers a cell speaks for it."""

    snapshot: Instant
    control: tuple[ControlTable, ...] = ()
    without: Annotated[dict[Api, str], Meta(description="adapters that can have no control, and why")] = field(
        default_factory=dict
    )


def folder() -> Path | None:
    """Return the folder of the controls: beside the package in a checkout, inside it in a wheel; None for none."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return Path(named) if named else None
    package = Path(__file__).parent.parent
    inside = package / "matrices" / MATRIX
    return inside if inside.is_dir() else package.parent / "matrices" / MATRIX


@cache
def read(place: Path) -> ControlsFile:
    """Return the controls of a folder. Raises BadInput."""
    path = place / FILE
    return schema.load_toml(_text(path), ControlsFile, str(path))


@cache
def _lock(place: Path, name: str) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    """Return the lock of a control: name to version and hashes of all files that it allows."""
    return locks.read_pins(_text(place / f"{name}.txt"))


def _text(path: Path) -> str:
    try:
        return given_files.read_text(path)
    except BadInput as error:
        message = f"{error}; {VARIABLE} names the folder of the controls"
        raise BadInput(message) from None


# --- from a cell to its controls, and from a control to its cell -----------------------------------------------


def find_controls(record: CellRecord) -> dict[str, Cell | str]:
    """Return the control, as a cell, of each adapter with a failure after the install; or why there is none."""
    from harness.judging.assess import assess  # noqa: PLC0415 - start-up

    # A case with `required` may fail by a finding alone, which only `assess` counts.
    if not any(case.api and (case.required or _fails(case.phases)) for case in record.cases):
        return {}
    if record.installed is None or record.cell.matrix == MATRIX or unregistered_id(record) or folder() is None:
        return {}
    # `assess` counts a failure that a control shares as infra: the record would no longer ask for that control.
    plain = replace(record, controls={}) if record.controls else record
    failing = (case.record.api for case in assess(plain).cases if case.record.api and _fails(case.phases))
    return {api: find_control(api, record.installed) for api in dict.fromkeys(failing)}


def find_control(api: str, installed: Mapping[str, str]) -> Cell | str:
    """Return the control of an adapter that speaks for these versions, or why there is none."""
    place = folder()
    if place:
        for table in read(place).control:
            if table.api == api and _covers(table.covers, installed):
                return _cell(place, table.id)
        if reason := read(place).without.get(api):
            return f"the adapter {api} has no control: {reason}"
    return f"the adapter {api} has no control for these versions"


def possible(cell: Cell, lock: str) -> tuple[Cell, ...]:
    """Return the controls that a failure of a cell with this lock (its text) would turn on."""
    versions = {str(canonicalize_name(name)): version for name, (version, _) in locks.read_pins(lock).items()}
    candidates = (find_control(api, versions) for api in dict.fromkeys(case.api for case in cell.cases if case.api))
    return tuple(one for one in candidates if isinstance(one, Cell))


def cells() -> tuple[Cell, ...]:
    """Return all controls, as cells."""
    place = folder()
    return tuple(_cell(place, table.id) for table in read(place).control) if place else ()


def _fails(phases: Iterable[PhaseRecord]) -> bool:
    return any(phase.outcome in FAILING for phase in phases)


def _covers(text: str | None, installed: Mapping[str, str]) -> bool:
    if text is None:
        return True
    version = installed.get(required_name(text))
    return version is not None and parsed_requirement(text).specifier.contains(version, prereleases=True)


@cache
def _cell(place: Path, name: str) -> Cell:
    table = next(one for one in read(place).control if one.id == name)
    # The question asks for the versions of the lock; `requirements` only say what that was made of.
    pins = tuple(f"{name}=={version}" for name, (version, _) in _lock(place, table.id).items())
    case = Case(
        id=table.id,
        env=table.env,
        api=table.api,
        kwargs=table.kwargs,
        checks=checks_of(table.checks),
        timeouts=table.timeouts,
    )
    return Cell(
        id=f"{MATRIX}/{table.id}",
        matrix=MATRIX,
        axes={"python": table.python},
        python=table.python,
        question=Question(
            requirements=pins,
            build_constraints=table.build_constraints,
            snapshot=read(place).snapshot,
        ),
        environment={},
        cases=(case,),
    )


# --- from what became of a control to what that says -----------------------------------------------------------


def judge(record: CellRecord, lock: str | None) -> ControlRecord:
    """Judge a control's cell and return the control's record; `lock` is the text of the lock that it was run with."""
    from harness.judging.assess import assess  # noqa: PLC0415 - start-up

    name = f"control {record.cell.label}"
    judged = assess(record)
    match judged.verdict:
        case Verdict.WORKS | Verdict.MISLEADS | Verdict.PARTIAL | Verdict.BROKEN | Verdict.IMPORT_FAILS:
            other = _differs(record.cell, lock or "")
        case _:
            other = f"{judged.phase or 'nothing'} {judged.phases[judged.phase] if judged.phase else 'ran'}"
            other += f": {judged.decisive}" if judged.decisive else ""
    if other:
        return ControlRecord(control=name, untold=f"the {name} could not be run: {other}")
    checks = [check for case in record.cases for phase in case.phases for check in phase.checks]
    return ControlRecord(
        control=name,
        passed=tuple(check.check for check in checks if check.outcome is Outcome.PASSED),
        failed={check.check: check.decisive or check.outcome for check in checks if check.outcome in FAILING},
    )


def _differs(cell: Cell, text: str) -> str | None:
    """Return a sentence on the first package that is not as in the known-good lock; None if all are.

    The known-good lock allows more files than a lock has: those of other machines.
    """
    place = folder()
    good_lock = _lock(place, cell.label) if place else {}
    for name, (version, hashes) in locks.read_pins(text).items():
        good, allowed = good_lock.get(str(canonicalize_name(name)), ("", ()))
        if version != good or not set(hashes) <= set(allowed):
            return f"{name} {version} from the package index is not the one that is known to be good"
    return None

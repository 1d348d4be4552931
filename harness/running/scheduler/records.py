"""Complete the record of a cell, at its end or where it was stopped."""

from __future__ import annotations

from collections.abc import Iterator

from harness.machine.store import InstallResult, now
from harness.model import Case, CaseRecord, Cell, CellRecord, Outcome, Phase, PhaseRecord, Step, replace
from harness.model.vocabulary import FAMILY
from harness.running import case_run


def finish_record(record: CellRecord) -> CellRecord:
    """Return the record with the fields that are known only at its end."""
    measured = max((phase.measured for phase in _phases(record) if phase.measured), default=now())
    whole = record.install and record.install.outcome is Outcome.PASSED and case_run.reusable(record.cases)
    mark = record.mark if whole else None
    return replace(record, measured=measured, mark=mark, seconds=_seconds(record), reused=_reused(record))


def stopped_record(record: CellRecord, step: Step) -> CellRecord:
    """Return a record whose resolve or install did not succeed: the cases are not reached."""
    cases = not_reached(record.cell)
    if step.outcome is Outcome.UNAVAILABLE:
        return replace(record, unavailable=step.decisive, cases=cases)
    if step.phase is Phase.INSTALL:
        # A build may fail while uv resolves (`uv_failures`): that is a failed install, so resolving passed.
        passed = Step(phase=Phase.RESOLVE, outcome=Outcome.PASSED, reused=step.reused)
        resolve = record.resolve if record.lock else passed
        return replace(record, resolve=resolve, install=step, cases=cases)
    return replace(record, resolve=step, cases=cases)


def not_reached(cell: Cell) -> tuple[CaseRecord, ...]:
    """Return the cases of a cell whose environment never came to be."""
    return tuple(case_run.not_reached(case) for case in cell.cases)


def with_modules(case: Case, installed: InstallResult) -> Case:
    """Return the case with the modules of its packages; a package without modules is left to fail by its name.

    Those that declare that they need the API come first: the others may register environments with it, too. Last come
    packages that an extra or another package brought.
    """
    speaking = installed.speaking.get(case.api, ())
    module_names = (installed.modules.get(name) or (name.replace("-", "_"),) for name in case.packages)
    ordered = sorted(
        zip(case.packages, module_names, strict=True), key=lambda row: bool(case.api) and row[0] not in speaking
    )
    modules = tuple(module for _, names in ordered for module in names)
    if case.env is None:
        return replace(case, imports=(*case.imports, *modules))
    if case.api not in FAMILY:
        return case
    others = (name for name in speaking if name not in {case.api, *case.packages})
    beside = tuple(module for name in others for module in installed.modules.get(name, ()))
    return replace(case, providers=modules, beside=beside)


def _phases(record: CellRecord) -> Iterator[PhaseRecord]:
    suite = (record.suite,) if record.suite else ()
    phases = (phase for case in record.cases for phase in case.phases)
    return (phase for phase in (*phases, *suite) if phase.measured)


def _seconds(record: CellRecord) -> float:
    steps = sum(step.seconds for step in (record.resolve, record.install) if step)
    return round(steps + sum(phase.seconds for phase in _phases(record)), 3)


def _reused(record: CellRecord) -> bool:
    """Return whether nothing of the record was measured in this run."""
    steps = [step.reused for step in (record.resolve, record.install) if step]
    return bool(steps) and all(steps) and all(phase.reused for phase in _phases(record))

"""The controls of adapters in a run: each is run once, when something failed with its adapter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from harness import controls
from harness.model import Cell, CellRecord, ControlRecord, Phase
from harness.scheduler import cell_faults
from harness.scheduler.pool import Unknown

if TYPE_CHECKING:
    from harness.scheduler.runner import Runner
    from harness.scheduler.settings import Observer


def due(runner: Runner, record: CellRecord) -> Iterator[Cell]:
    """The controls that a record turns on and that this run has not asked for yet."""
    for found in controls.wanted(record).values():
        if isinstance(found, Cell) and found.id not in runner.controls:
            yield found


def controlled(runner: Runner, record: CellRecord, *, quick: bool = False) -> CellRecord:
    """The record with the controls that it turns on; `quick` raises Unknown where one would have to be run."""
    wanted = controls.wanted(record)
    found = {api: _found(runner, control, quick=quick) for api, control in wanted.items()}
    if found == record.controls:
        return record
    runner.unchanged.discard(record.cell.id)
    return replace(record, controls=found)


def _found(runner: Runner, control: Cell | str, *, quick: bool) -> ControlRecord:
    if isinstance(control, str):
        return ControlRecord(control="none", untold=control)
    return ran(runner, control, quick=quick)


def ran(runner: Runner, control: Cell, *, quick: bool = False) -> ControlRecord:
    """What a control came to: in this run, as it is stored, or run now."""
    with runner.once.turn(("control", control.id)):
        if control.id not in runner.controls:
            try:
                runner.controls[control.id] = _ran(runner, control, quick=quick)
            except Unknown:
                raise
            except Exception as error:
                step = cell_faults.fault(runner, control, Phase.RESOLVE, error)
                untold = f"the {_name(control)} could not be run: {step.decisive}"
                runner.controls[control.id] = ControlRecord(control=_name(control), untold=untold)
    return runner.controls[control.id]


def _ran(runner: Runner, control: Cell, *, quick: bool) -> ControlRecord:
    beside = replace(runner, settings=replace(runner.settings, until=Phase.SUITE), observer=Beside(runner.observer))
    record = beside.known(control)
    if record is None:
        if quick:
            raise Unknown
        case = control.cases[0]
        runner.observer.say(f"a {case.api} task failed; to rule out this machine, the {_name(control)} is run, too")
        record = beside.measure(control)
    beside.keep(record)
    text = (runner.store.folder / record.lock).read_text(encoding="utf-8") if record.lock else None
    return controls.said(record, text)


def _name(control: Cell) -> str:
    return f"control {control.label}"


class Beside:
    """Tells of controls nothing but what a user has to know: their cells are none of those that are counted."""

    def __init__(self, observer: Observer) -> None:
        self.say = observer.say

    def started(self, cell: Cell) -> None:
        """It was said before."""

    def step(self, cell: Cell, text: str) -> None:
        """Not shown."""

    def done(self, record: CellRecord) -> None:
        """Told by what comes of other cells."""

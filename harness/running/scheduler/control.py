"""Run the control of an adapter once, when something failed with that adapter."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from harness.model import Cell, CellRecord, ControlRecord, Phase, replace
from harness.model.errors import BadInput
from harness.running import controls
from harness.running.scheduler import cell_faults
from harness.running.scheduler.runner import Runner
from harness.running.scheduler.settings import QuietObserver
from harness.running.scheduler.steps import Steps, carry_out, peek, pending


class ControlledRunner(Struct, frozen=True):
    """A runner of cells that completes each record with the controls that it turns on.

    `results` has the record of every control that was asked for, by its id; runners of other settings may share it.
    """

    runner: Runner
    results: dict[str, ControlRecord] = {}

    def measure(self, cell: Cell) -> CellRecord:
        """Take one cell through its phases; keep its results, but not its record."""
        return self.complete(self.runner.measure(cell))  # it may wait for others, and so holds nothing of theirs

    def find_record(self, cell: Cell) -> CellRecord | None:
        """Return the record of a cell of which everything is known; None where something has to be done."""
        record = self.runner.find_record(cell)
        try:
            return peek(self._completed(record)) if record else None
        except BadInput:
            raise
        except Exception:  # Unknown; anything else is met again, and said, where something is done about the cell
            return None

    def due(self, record: CellRecord) -> Iterator[Cell]:
        """Yield the controls that a record turns on and that nobody has asked for yet."""
        for control in controls.find_controls(record).values():
            if isinstance(control, Cell) and control.id not in self.results:
                yield control

    def complete(self, record: CellRecord) -> CellRecord:
        """Return a record with the controls that it turns on, which are run where they have not been."""
        return carry_out(self._completed(record))

    def run(self, control: Cell) -> ControlRecord:
        """Return the record of a control: from this run, from the store, or run now."""
        return carry_out(self._result(control))

    def _completed(self, record: CellRecord) -> Steps[CellRecord]:
        results = {}
        for api, control in controls.find_controls(record).items():
            results[api] = yield from self._result(control)
        if results == record.controls:
            return record
        self.runner.unchanged.discard(record.cell.id)
        return replace(record, controls=results)

    def _result(self, control: Cell | str) -> Steps[ControlRecord]:
        if isinstance(control, str):
            return ControlRecord(control="none", untold=control)
        with self.runner.once.turn(("control", control.id)):
            if control.id not in self.results:
                try:
                    self.results[control.id] = yield from self._recorded(control)
                except Exception as error:
                    step = cell_faults.fault(self.runner, control, Phase.RESOLVE, error)
                    untold = f"the {_name(control)} could not be run: {step.decisive}"
                    self.results[control.id] = ControlRecord(control=_name(control), untold=untold)
        return self.results[control.id]

    def _recorded(self, control: Cell) -> Steps[ControlRecord]:
        """Look a control up or measure it, to the last phase; keep its record as that of any cell."""
        runner = self.runner
        # To the last phase, whatever this run wants: runners of other settings share the result.
        beside = replace(
            runner, settings=replace(runner.settings, until=Phase.SUITE), observer=QuietObserver(runner.observer)
        )
        record = beside.find_record(control) or (yield from pending(lambda: self._measured(beside, control)))
        beside.keep(record)
        text = (runner.store.folder / record.lock).read_text(encoding="utf-8") if record.lock else None
        return controls.judge(record, text)

    def _measured(self, beside: Runner, control: Cell) -> CellRecord:
        case, name = control.cases[0], _name(control)
        self.runner.observer.say(f"a {case.api} task failed; to rule out this machine, the {name} is run, too")
        return beside.measure(control)


def _name(control: Cell) -> str:
    return f"control {control.label}"

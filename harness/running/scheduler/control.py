"""Run the control of an adapter once, when something failed with that adapter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from harness.model import Cell, CellRecord, ControlRecord, Phase
from harness.model.errors import BadInput
from harness.running import controls
from harness.running.scheduler import cell_faults
from harness.running.scheduler.pool import Unknown
from harness.running.scheduler.runner import Runner
from harness.running.scheduler.settings import Observer


@dataclass(frozen=True, slots=True)
class Controlled:
    """A runner of cells that completes each record with the controls that it turns on.

    `results` has the record of every control that was asked for, by its id; runners of other settings may share it.
    """

    runner: Runner
    results: dict[str, ControlRecord] = field(default_factory=dict)

    def measure(self, cell: Cell) -> CellRecord:
        """Take one cell through its phases; keep its results, but not its record."""
        return self.complete(self.runner.measure(cell))  # it may wait for others, and so holds nothing of theirs

    def known(self, cell: Cell) -> CellRecord | None:
        """Return the record of a cell of which everything is known; None where something has to be done."""
        record = self.runner.known(cell)
        try:
            return self.complete(record, quick=True) if record else None
        except BadInput:
            raise
        except Exception:  # Unknown; anything else is met again, and said, where something is done about the cell
            return None

    def due(self, record: CellRecord) -> Iterator[Cell]:
        """Yield the controls that a record turns on and that nobody has asked for yet."""
        for found in controls.wanted(record).values():
            if isinstance(found, Cell) and found.id not in self.results:
                yield found

    def complete(self, record: CellRecord, *, quick: bool = False) -> CellRecord:
        """Return a record with the controls that it turns on; `quick` raises Unknown where one had to be run."""
        wanted = controls.wanted(record)
        found = {api: self._result(control, quick=quick) for api, control in wanted.items()}
        if found == record.controls:
            return record
        self.runner.unchanged.discard(record.cell.id)
        return replace(record, controls=found)

    def _result(self, control: Cell | str, *, quick: bool) -> ControlRecord:
        if isinstance(control, str):
            return ControlRecord(control="none", untold=control)
        return self.run(control, quick=quick)

    def run(self, control: Cell, *, quick: bool = False) -> ControlRecord:
        """Return the record of a control: from this run, from the store, or run now."""
        with self.runner.once.turn(("control", control.id)):
            if control.id not in self.results:
                try:
                    self.results[control.id] = self._run(control, quick=quick)
                except Unknown:
                    raise
                except Exception as error:
                    step = cell_faults.fault(self.runner, control, Phase.RESOLVE, error)
                    untold = f"the {_name(control)} could not be run: {step.decisive}"
                    self.results[control.id] = ControlRecord(control=_name(control), untold=untold)
        return self.results[control.id]

    def _run(self, control: Cell, *, quick: bool) -> ControlRecord:
        runner = self.runner
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
    """An observer that passes on only what a user has to know of controls: their cells are not counted."""

    def __init__(self, observer: Observer) -> None:
        self.say = observer.say

    def started(self, cell: Cell) -> None:
        """Show nothing: the user was informed before."""

    def step(self, cell: Cell, text: str) -> None:
        """Show nothing."""

    def done(self, record: CellRecord) -> None:
        """Show nothing: the records of other cells show the result."""

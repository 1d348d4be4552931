"""Repair every red cell of a run, once per cause: a cure is tried first on the other cells with the same cause."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from harness.judging.assess import assess
from harness.judging.identity import Failure
from harness.machine.store import Store
from harness.matrix import changes
from harness.model import Cell, CellRecord, Change, replace
from harness.model.vocabulary import required_name
from harness.rootcause.repair.lab import Lab
from harness.rootcause.repair.repairing import RepairResult, Search, Status
from harness.running.signatures import shipped_signatures

REPAIR = "repair"


@dataclass(frozen=True, kw_only=True, slots=True)
class SolvedCause:
    """A cause that was investigated, and the change that cures it; None if nothing does."""

    failed: Failure
    names: frozenset[str]
    change: Change | None


@dataclass(frozen=True, kw_only=True, slots=True)
class RepairedCell:
    """One red cell, and the result of its repair."""

    cell: Cell
    repaired: RepairResult
    lab: Lab

    @property
    def cured(self) -> CellRecord | None:
        """Return the record of the cell with its remedy, for the report; None if there is no remedy."""
        if self.repaired.status is not Status.FOUND or self.repaired.proof is None:
            return None
        record = self.repaired.proof.record
        name = changes.id_of(self.cell, REPAIR, self.repaired.change or Change())
        tried = replace(record.cell.tried, reason=self.repaired.why) if record.cell.tried else None
        return replace(record, cell=replace(record.cell, id=name, tried=tried))


def repair_every(records: Iterable[CellRecord], opened: Store, lab: Callable[[Cell], Lab]) -> Iterator[RepairedCell]:
    """Repair the red cells among these, expected or not. `lab` makes a place to try changes for each."""
    solved: list[SolvedCause] = []
    signatures = shipped_signatures.load_knowledge(opened.folder)
    for record in records:
        failed = assess(record, signatures).failure
        # A cell with a `base` is a change that is tried on another cell; that other cell is the one to repair.
        if failed is None or record.cell.base:
            continue
        names = frozenset(map(required_name, record.cell.question.requirements))
        alike = [one for one in solved if one.names == names and one.failed.same(failed)]
        with lab(record.cell) as place:
            repaired = _again(place, [one.change for one in alike if one.change]) if alike else Search(place).run()
        if repaired is None:
            continue
        # A cause without a remedy is kept, too: later cells with this cause are passed over, not searched again.
        if repaired.status is Status.FOUND or not alike:
            solved.append(SolvedCause(failed=failed, names=names, change=repaired.change))
        yield RepairedCell(cell=record.cell, repaired=repaired, lab=place)


def _again(place: Lab, changes: Iterable[Change]) -> RepairResult | None:
    """Try remedies of the same cause on this cell, then search for its own. None if the cause has no remedy."""
    tried = False
    for change in changes:
        tried = True
        result = Search(place).proven(change)
        if result:
            return result
    return Search(place).run() if tried else None

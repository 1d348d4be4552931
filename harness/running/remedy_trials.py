"""Make cells that try a remedy of a known failure, where nobody has tried it yet on a cell with that failure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from harness.matrix import changes
from harness.matrix.signatures import Signature
from harness.model import Cell, Change, Plan, Question, Repair, Tried, replace

if TYPE_CHECKING:
    from harness.judging.assess import Assessed

Recipes = Mapping[str, tuple[Repair, ...]]


def make_trials(cells: Sequence[Cell], assessed: Iterable[Assessed], recipes: Callable[[], Recipes]) -> Iterator[Cell]:
    """Yield red cells with their remedies applied, the deepest cause first.

    Of cells that ask the same there is one for each cause. `cells` are all that are planned; some may be such a cell
    already.
    """
    tried: dict[str, list[Cell]] = {}
    for cell in cells:
        if cell.base:
            tried.setdefault(cell.base, []).append(cell)
    places: list[tuple[str, str, Question]] = []
    for assessment in assessed:
        record = assessment.record
        if record.cell.base:
            continue
        for diagnosis in assessment.diagnoses:
            change = diagnosis.signature.remedy.change
            place = (diagnosis.signature.id, record.cell.python, record.cell.question)
            if change is None or place in places:
                continue
            trial = _apply_remedy(record.cell, diagnosis.signature, change, recipes())
            if trial and not any(changes.same(trial, other) for other in tried.get(record.cell.id, ())):
                places.append(place)
                yield trial


def _apply_remedy(cell: Cell, signature: Signature, change: Change, recipes: Recipes) -> Cell | None:
    """Return the cell with the remedy; None if the remedy is not to be had, or leaves the cell as it is."""
    try:
        trial = changes.apply(cell, change, recipes)
    except ValueError:
        return None
    if changes.same(trial, cell):
        return None
    tried = Tried(name=signature.id, reason=f"the remedy of {signature.id}", change=change, proving=True)
    name = changes.id_of(cell, signature.id, change)
    return replace(trial, id=name, base=cell.id, tried=tried, expect=None)


def add(plan: Plan, more: Iterable[Cell]) -> Plan:
    """Return the plan with these cells of its matrix, each behind the cell that it was made of."""
    by_base: dict[str, list[Cell]] = {}
    for cell in more:
        by_base.setdefault(cell.base or "", []).append(cell)
    return replace(plan, cells=tuple(each for cell in plan.cells for each in (cell, *by_base.get(cell.id, ()))))

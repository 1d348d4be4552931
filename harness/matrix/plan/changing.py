"""Try single changes on planned cells: each makes a changed copy of every cell that it fits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from msgspec import structs

from harness.matrix import changes
from harness.matrix.matrix_types import ChangedTable, ChangeTable, Matrix
from harness.matrix.plan.choices import Choice, Combination, condition
from harness.matrix.plan.contents import Contents
from harness.model import Cell, Expectation, Tried, cellid, decoding, replace
from harness.model.schema import locate_errors
from harness.model.vocabulary import Kind

BESIDES = ("needs", "system", "files", "empty", "python_path", "bring", "extras", "groups")
UNCHANGED = "the change leaves the cell as it is"


@dataclass
class Changing:
    """The changes of a matrix, applied to one cell after the other. `claim` refuses an id that is taken."""

    matrix: Matrix
    contents: Contents
    claim: Callable[[str], None]
    dropped: dict[str, str] = field(default_factory=dict)
    fitting: set[int] = field(default_factory=set)
    cell_ids: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.choices = [_choice(table) for table in self.matrix.change]
        self.conditions = [condition(self.matrix, table.when) for table in self.matrix.change]

    def of(self, cell: Cell, combination: Combination) -> Iterator[Cell]:
        """Yield the changed copies of a cell; those equal to the cell itself are dropped."""
        for index, table in enumerate(self.matrix.change):
            if self.conditions[index].holds(combination) and (not table.cells or cellid.fits(table.cells, cell)):
                self.fitting.add(index)
                with locate_errors(self.matrix.path, "change", index):
                    changed = self._changed(cell, combination, index, table)
                    if changed.id in self.cell_ids:
                        message = f'another change of {cell.id} is called "{table.name}", too'
                        raise ValueError(message)
                    self.claim(changed.id)
                    self.cell_ids.add(changed.id)
                if changes.same(changed, cell):
                    self.dropped[changed.id] = UNCHANGED
                else:
                    yield changed

    def stale(self, file: str) -> Iterator[str]:
        """Yield a line for each change that fits no cell."""
        for index, table in enumerate(self.matrix.change):
            if index not in self.fitting:
                yield f'{file}: change[{index}] ("{table.name}") matches no cell'

    def _changed(self, cell: Cell, combination: Combination, index: int, table: ChangeTable) -> Cell:
        choice = self.choices[index]
        change = self.contents.change(choice, table, combination)
        around = self.contents.surroundings((*combination, choice))
        # `environment` is left to `apply`, which adds it last: a change wins over a variable axis, too.
        surrounded = replace(
            cell,
            **around | {"environment": cell.environment},
            subject=self.contents.subject((*combination, choice)),
        )
        return replace(
            changes.apply(surrounded, change, self.contents.recipes),
            id=changes.id_of(cell, table.name, change),
            base=cell.id,
            tried=Tried(
                name=table.name,
                reason=table.reason,
                change=change,
                also=tuple(_besides(table)),
                advice=table.advice,
                link=table.link,
            ),
            expect=_expectation(table.expect, table.reason),
        )


def _choice(table: ChangeTable) -> Choice:
    """Return the change as the value of an axis after all others, so that its additions come last."""
    name = table.name
    return Choice(axis="change", kind=Kind.BUNDLE, literal=name, text=name, label=name, changes=table)


def _besides(table: ChangeTable) -> Iterator[str]:
    for key in BESIDES:
        if names := getattr(table, key):
            yield f"{key.replace('_', ' ')} {', '.join(f'`{name}`' for name in names)}"


def _expectation(table: ChangedTable, reason: str) -> Expectation | None:
    """Return the expectation for a changed cell; None if it is only expected to work."""
    if table == ChangedTable():
        return None
    return decoding.convert(structs.replace(table, reason=table.reason or reason), Expectation, attributes=True)

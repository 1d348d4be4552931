"""Find the one cell that a command line names by id, label or glob: of a matrix, or of `try` runs on this machine."""

from __future__ import annotations

from collections.abc import Sequence

from harness.machine import this_machine
from harness.machine.console import tell
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import Cell, Plan, cellid
from harness.model.errors import BadInput
from harness.model.schema import suggestion
from harness.reports.answers import misspelt
from harness.running import open_matrix

LISTED = 10


def find(verb: str, text: str, opened: Store, *, offline: bool = False) -> tuple[Plan, Cell]:
    """Return the plan and its cell, as the matrix plans it today; a cell of `try` as it was run. Raises BadInput."""
    matrix, _, label = text.partition("/")
    if text.endswith(".toml") or not label:
        message = (
            f'{verb} {text}: name a combination, such as "quickstart/py3.11_gymnasium-1.2.3_mujoco-3.3.7" '
            'or "quickstart/*"'
        )
        raise BadInput(message)
    if matrix == plan.TRY_MATRIX:
        return _find_try_cell(verb, text, opened)
    name, _, label = text.rpartition(".toml/")  # a matrix of the user's own: PATH.toml/LABEL
    planned = open_matrix.load(f"{name}.toml" if name else matrix, tell, offline=offline)
    planned = open_matrix.set_instant(planned, opened, offline=offline)
    cell = _match_cell(verb, text, label or text, planned.cells)
    misspelt.check_cells([cell], tell, offline=offline)
    return planned, cell


def _find_try_cell(verb: str, text: str, opened: Store) -> tuple[Plan, Cell]:
    here = this_machine.facts().id
    cells = [one.cell for one in opened.cells() if one.machine == here and one.cell.matrix == plan.TRY_MATRIX]
    cell = _match_cell(verb, text, text, cells)
    return Plan(matrix=cell.matrix, cells=(cell,), axes=tuple(cell.axes)), cell


def _match_cell(verb: str, text: str, pattern: str, cells: Sequence[Cell]) -> Cell:
    matches = cellid.select(pattern, cells)
    if single(verb, text, [cell.id for cell in matches]) is None:
        message = f"{verb} {text}: no such combination{suggestion(text, [cell.id for cell in cells])}"
        raise BadInput(message)
    return matches[0]


def single(verb: str, text: str, ids: Sequence[str]) -> str | None:
    """Return the one id that a name on the command line matches; None if none. Raises BadInput if there are several."""
    if len(ids) > 1:
        more = f", and {len(ids) - LISTED} more" if len(ids) > LISTED else ""
        message = f"{verb} {text}: matches {len(ids)} combinations; name one of {', '.join(ids[:LISTED])}{more}"
        raise BadInput(message)
    return next(iter(ids), None)

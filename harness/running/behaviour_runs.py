"""Measure one environment of a cell: make a bank of states in it, or step it from the states of one, or draw them."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from harness.judging.assess import assess
from harness.machine.store import Store
from harness.model import Case, CaseRecord, Cell, Phase, replace
from harness.model.errors import BadInput, CouldNotTell
from harness.model.vocabulary import DRAW, IMPORT_CHECK, MAKE_BANK, PLAY, STEP
from harness.physics.outputs import Bank
from harness.probes import array_files
from harness.probes.evidence import BANK, OUTPUTS, PIXELS, PLAYED
from harness.probes.vault import MOST_FILE, Vault
from harness.running.scheduler import Observer, Runner, Settings

SECONDS = {Phase.BEHAVE: 1800.0}


def make_bank(cell: Cell, case: Case, opened: Store, settings: Settings, observer: Observer) -> dict[str, NDArray[Any]]:
    """Return a bank of states of a case, with what each of them leads to in this cell."""
    wanted = _only(cell, replace(case, bank=None, checks=(IMPORT_CHECK, MAKE_BANK)))
    return _measure(wanted, BANK, opened, settings, observer)[0]


def step_from(
    cell: Cell, case: Case, bank: str, opened: Store, settings: Settings, observer: Observer
) -> dict[str, NDArray[Any]]:
    """Return what the states of a bank (its SHA-256 in the vault) lead to in a case of a cell."""
    return _measure(stepping_cell(cell, case, bank), OUTPUTS, opened, settings, observer)[0]


def draw_states(
    cell: Cell, case: Case, bank: str, opened: Store, settings: Settings, observer: Observer
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return what was drawn of the states of a bank in a case of a cell, and the paths of the frames."""
    wanted = _only(cell, replace(case, bank=bank, checks=(IMPORT_CHECK, DRAW)))
    arrays, record = _measure(wanted, PIXELS, opened, settings, observer)
    return arrays, tuple(frame for phase in record.phases for frame in phase.frames)


def play(cell: Cell, case: Case, opened: Store, settings: Settings, observer: Observer) -> dict[str, NDArray[Any]]:
    """Return the episodes that the policy of a case plays in a cell."""
    wanted = _only(cell, replace(case, bank=None, checks=(IMPORT_CHECK, PLAY)))
    return _measure(wanted, PLAYED, opened, settings, observer)[0]


def stepping_cell(cell: Cell, case: Case, bank: str) -> Cell:
    """Return the cell with this case alone, stepped from a bank (its SHA-256 in the vault)."""
    return _only(cell, replace(case, bank=bank, checks=(IMPORT_CHECK, STEP)))


def read_bank(name: str, vault: Vault) -> Bank:
    """Return a bank in the vault, by its SHA-256."""
    arrays = array_files.decode(vault.content(name, MOST_FILE))
    return Bank.of(arrays, array_files.facts(arrays))


def arrays_of(record: CaseRecord, name: str, vault: Vault) -> dict[str, NDArray[Any]] | None:
    """Return the arrays that the runs of a case left under a name, of the last run that has them."""
    for run in reversed(record.runs):
        content = vault.reading(run).run.files.get(name)
        if content:
            return array_files.decode(vault.content(content, MOST_FILE))
    return None


def case_of(cell: Cell, env: str | None) -> Case:
    """Return the case of a cell that an environment id or a case id names; the only one for None. Raises BadInput."""
    cases = [case for case in cell.cases if case.env and env in {None, case.env, case.id}]
    if len(cases) != 1:
        names = ", ".join(case.env for case in cell.cases if case.env)
        message = f"{cell.id}: name one environment with --env: {names}" if names else f"{cell.id}: has no environment"
        raise BadInput(message)
    return cases[0]


def _only(cell: Cell, case: Case) -> Cell:
    return replace(cell, cases=(replace(case, timeouts={**case.timeouts, **SECONDS}),))


def _measure(
    cell: Cell, name: str, opened: Store, settings: Settings, observer: Observer
) -> tuple[dict[str, NDArray[Any]], CaseRecord]:
    record = Runner(opened, settings, observer).measure(cell)
    arrays = arrays_of(record.cases[0], name, Vault(opened.folder)) if record.cases else None
    if arrays is None:
        judged = assess(record)
        reason = judged.decisive or next(
            (check.decisive for phase in record.cases[0].phases for check in phase.checks if check.decisive),
            judged.verdict,
        )
        message = f"{cell.id}: {cell.cases[0].env}: its behaviour could not be measured: {reason}"
        raise CouldNotTell(message)
    return arrays, record.cases[0]

"""Find values of a first matrix that fail only because of the newest releases of the other axes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

from harness.machine import interpreters
from harness.machine.store import Store
from harness.model import Cell, Interpreter, Outcome, Phase, replace
from harness.model.vocabulary import required_name
from harness.running.scheduler import Observer, Runner, Settings

PYTHON = "python"


def find_clashes(
    cells: Sequence[Cell], packages: Collection[str], opened: Store, observer: Observer
) -> dict[str, tuple[str, ...]]:
    """Return, by axis, the values (versions, Pythons) that resolve only without the pins of the other package axes.

    Cells vary one axis at a time. A value that does not resolve without those pins either stays: the project says
    that it works with it, and it does not.
    """
    runner = Runner(opened, Settings(until=Phase.RESOLVE), observer)
    names = (PYTHON, *packages)
    common = {name: Counter(cell.axes.get(name) for cell in cells).most_common(1)[0][0] for name in names}
    clashes: dict[str, list[str]] = {}
    # The cell of the common values comes first: a value can be blamed only where those fit each other.
    for cell in sorted(cells, key=lambda cell: sum(cell.axes.get(name) != common[name] for name in names)):
        odd = [name for name in names if cell.axes.get(name) != common[name]]
        interpreter = interpreters.find(cell.python)
        if not odd and interpreter and not _resolves(runner, cell, interpreter):
            return {}  # the newest of all do not fit each other: no value is at fault
        if len(odd) == 1 and interpreter and not _resolves(runner, cell, interpreter):
            others = {name for name in packages if name != odd[0]}
            requirements = tuple(line for line in cell.question.requirements if required_name(line) not in others)
            if _resolves(
                runner, replace(cell, question=replace(cell.question, requirements=requirements)), interpreter
            ):
                clashes.setdefault(odd[0], []).append(cell.axes[odd[0]])
    return {name: tuple(versions) for name, versions in clashes.items()}


def _resolves(runner: Runner, cell: Cell, interpreter: Interpreter) -> bool:
    """Return whether the cell resolves. If the network or this machine prevents an answer, assume that it does."""
    lock, step = runner.lock_of(cell, interpreter)
    return lock is not None or step.outcome is not Outcome.FAILED or step.phase is not Phase.RESOLVE

"""A plan that no longer changes: made once by the controller, handed to every worker as text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.commands import select_cells
from harness.machine.store import Store, open_store
from harness.model import CASE_PHASES, Cell, Phase, Plan
from harness.running import open_matrix
from harness.running.scheduler import Settings


@dataclass(frozen=True, kw_only=True, slots=True)
class SessionPlan:
    """The cells of a session and how they are to be measured; `state` is the folder of the store."""

    plans: tuple[Plan, ...]
    state: str
    fresh: bool = False
    offline: bool = False
    verify: bool = False

    def settings(self, until: Phase = CASE_PHASES[-1]) -> Settings:
        """Return the settings of the scheduler, up to a phase."""
        return Settings(until=until, fresh=self.fresh, offline=self.offline, verify=self.verify)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Return the cells of all matrices, in their order."""
        return tuple(cell for plan in self.plans for cell in plan.cells)

    @property
    def store(self) -> Store:
        """Return the store of the results, the same for all workers."""
        return Store(Path(self.state))


def freeze(
    matrices: Sequence[str],
    say: Callable[[str], None],
    *,
    fresh: bool = False,
    offline: bool = False,
    verify: bool = False,
    listed: bool = False,
) -> SessionPlan:
    """Plan the matrices as `run` does: expanded, and with the instant that their locks are made as of.

    With `listed`, plan from files alone and set no instant.
    """
    planned = [open_matrix.load(name, say, offline=offline or listed) for name in matrices]
    select_cells.check_distinct(planned)
    select_cells.select([cell for plan in planned for cell in plan.cells], None)
    store = open_store()
    plans = tuple(plan if listed else open_matrix.set_instant(plan, store, offline=offline) for plan in planned)
    return SessionPlan(plans=plans, state=str(store.folder), fresh=fresh, offline=offline, verify=verify)

"""Resolve many questions at once, only to learn whether they resolve."""

from __future__ import annotations

import sysconfig
from collections.abc import Sequence

from harness.machine import capacity
from harness.machine.store import Store
from harness.matrix.plan import Ask
from harness.model import Cell, Outcome
from harness.model.errors import CouldNotTell
from harness.running import scheduler


def asking(store: Store, settings: scheduler.Settings) -> Ask:
    """Return a function that resolves cells, several at a time, and keeps the locks for the run to come.

    Its answers say why there is no lock. An answer is None if there is a lock, if this machine cannot tell (no such
    Python), or if a build failed: those are for the run to measure. A trouble of the network is CouldNotTell.
    """
    sysconfig.get_config_vars()  # its first use is not safe in threads, and finding uv is one
    runner = scheduler.Runner(store, settings, scheduler.QuietObserver())

    def reason(cell: Cell) -> str | None:
        step = runner.prepare(cell).record.resolve
        if step is None or step.outcome is Outcome.PASSED:
            return None
        if step.outcome is Outcome.INFRA:
            message = f"whether {cell.id} resolves: {step.decisive}"
            raise CouldNotTell(message)
        return step.decisive if step.outcome is Outcome.FAILED else None

    def ask(cells: Sequence[Cell]) -> list[str | None]:
        with scheduler.threads(settings.jobs or capacity.default_jobs()) as (pool,):
            return list(pool.map(reason, cells))

    return ask

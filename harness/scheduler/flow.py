"""Many cells at a time."""

from __future__ import annotations

import os
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager

from harness import machine, process
from harness.model import Cell, CellRecord
from harness.scheduler.runner import Runner
from harness.scheduler.settings import Observer, Settings
from harness.store import Store


def default_jobs() -> int:
    """One cell per core that this process may use."""
    return len(os.sched_getaffinity(0))


def run(cells: Sequence[Cell], store: Store, settings: Settings, observer: Observer) -> tuple[CellRecord, ...]:
    """Bring every cell as far as `settings.until`; the records come in the order of the cells."""
    sysconfig.get_config_vars()  # its first use is not safe in threads, and finding uv is one
    here = machine.facts()
    store.save_machine(here.id, here.facts)
    runner = Runner(store, settings, observer)
    results: dict[str, CellRecord] = {}
    with _pool(settings.jobs) as submit:
        pending: set[Future[CellRecord]] = {submit(runner.cell, cell) for cell in cells}
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in finished:
                record = future.result()
                results[record.cell.id] = record
    return tuple(results[cell.id] for cell in cells)


@contextmanager
def _pool(jobs: int) -> Iterator[Callable[..., Future[CellRecord]]]:
    """Threads that end, with every process they started, when the block is left by an exception."""
    pool = ThreadPoolExecutor(max_workers=jobs, thread_name_prefix="cell")
    try:
        yield pool.submit
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        process.stop()
        raise
    finally:
        pool.shutdown(wait=True)

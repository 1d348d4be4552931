"""Run many cells: report known cells at once, take the rest through two stages, of waiting and of computing.

    cells --prepare--> ready --probe--> records
            (I/O)      (heap)   (CPU)

Cells of one question are prepared together, since one resolution and one install serve them all. The first stage runs
ahead of the second by a few environments: probes never wait for the network, and no disk fills up with environments
that nobody has come to yet. Of the ready cells the longest goes first, if there is memory for it and nobody else is
measuring the same: then it waits, without a slot, and finds the result. A record with a failure waits for the control
of its adapter, which a thread of its own runs once.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from heapq import heappop, heappush
from threading import Thread
from typing import Any

from msgspec import Struct

from harness.machine import capacity, process, this_machine
from harness.machine.files.file_locks import Claim, claim
from harness.machine.store import Store, digest
from harness.model import Cell, CellRecord, ControlRecord, Phase, replace
from harness.probes import program
from harness.probes.vault import Vault
from harness.running import controls
from harness.running.scheduler import cell_faults
from harness.running.scheduler.admission import Room
from harness.running.scheduler.control import ControlledRunner
from harness.running.scheduler.cost_history import Past
from harness.running.scheduler.records import stopped_record
from harness.running.scheduler.runner import Prepared, Runner
from harness.running.scheduler.settings import WAITING, Observer, Settings

PREPARING = 3
"""Groups of cells that are resolved and installed at a time, as many as probes run, and two at least."""

LOOK_SECONDS = 0.25
"""How often it is asked whether memory is free again, and whether another process is done with the same cell."""

SWITCH_SECONDS = 0.0005
"""Seconds that a thread keeps Python to itself while others wait, a tenth of Python's default: most of ours wait for
files and processes, and after each of their short calls they would wait for one that computes."""

SIGNAL_SECONDS = 1.0  # a signal that another thread took is obeyed when this one runs again


def run(
    cells: Sequence[Cell],
    store: Store,
    settings: Settings,
    observer: Observer,
    meanwhile: Callable[[], None] = lambda: None,
) -> tuple[CellRecord, ...]:
    """Bring every cell as far as `settings.until`; the records come in the order of the cells.

    `meanwhile` is called once a core has nothing more to do and another one still has.
    """
    if os.environ.get(process.FORCED):
        process.sandbox_mode()  # a mistake there is said at once
    looks = start_looks(store)
    flow = Flow(Runner(store, settings, observer), meanwhile)
    # Where nothing is stored, nothing is looked for: interpreters are then asked side by side, group by group.
    left = [cell for cell in cells if not flow.report_stored(cell)] if store.has_cells() else list(cells)
    if left:
        _tell_of_old_results(store, observer)
        controls.cells()  # a mistake in what they are is said now, not in the middle
        sysconfig.get_config_vars()  # its first use is not safe in threads, and finding uv is one
        process.get_ready()
        flow.run(left, Past(store, lambda: this_machine.facts().id, left))
    looks.join()
    return tuple(flow.records[cell.id] for cell in cells)


def start_looks(store: Store) -> Thread:
    """Start a thread that finds out what every cell needs of this machine, beside the first commands."""
    thread = Thread(target=_look, args=(store,), name="looks", daemon=True)
    thread.start()
    return thread


def _look(store: Store) -> None:
    """Look at this machine, and keep what it is. What fails here fails again, and is told, where it is asked for."""
    with suppress(Exception):
        here = this_machine.facts()
        store.save_machine(here.id, here.facts)
        program.own()  # digested once for all runs, while the first resolutions are waited for


def _tell_of_old_results(store: Store, observer: Observer) -> None:
    """Say once that results of an earlier version are not reused: they do not say how a process ended."""
    if (store.folder / "results").is_dir() and not Vault(store.folder).folder.is_dir():
        text = "results of an earlier version do not say how a probe ended: what is asked for is measured again"
        observer.say(text)


@dataclass(order=True, slots=True)
class _Ready:
    """A prepared cell that waits for a slot, in its place of the order."""

    rank: tuple[float, int, int]
    prepared: Prepared = field(compare=False)
    memory_mb: int = field(compare=False)


class _Probing(Struct, frozen=True):
    """A cell that has a slot."""

    ready: _Ready
    claim: Claim


class Flow:
    """The cells on their way, seen and changed by one thread only."""

    def __init__(self, runner: Runner, meanwhile: Callable[[], None] = lambda: None) -> None:
        self.runner, self.controlled = runner, ControlledRunner(runner)
        self.meanwhile: Callable[[], None] | None = meanwhile
        self.records: dict[str, CellRecord] = {}
        settings = runner.settings
        memory = settings.reading if settings.jobs == capacity.AUTO else None
        self.room = Room(settings.jobs or capacity.default_jobs(), memory)
        alone = settings.until in {Phase.RESOLVE, Phase.INSTALL}
        beside = min(PREPARING, max(2, self.room.slots))  # unpacking wheels takes cores, too
        self.at_once = max(PREPARING, self.room.slots) if alone else beside
        self.groups: deque[list[Cell]] = deque()
        self.preparing: set[Future[list[Prepared]]] = set()
        self.ready: list[_Ready] = []
        self.environments: Counter[str | None] = Counter()  # of the ready
        self.probing: dict[Future[CellRecord], _Probing] = {}
        self.behind: dict[str, list[_Ready]] = {}  # what is measured here now, and who waits for that
        self.elsewhere: list[_Ready] = []  # another process measures the same
        self.controlling: dict[Future[ControlRecord], str] = {}
        self.held: dict[str, list[CellRecord]] = {}  # what waits for a control, by that

    def report_stored(self, cell: Cell) -> bool:
        """Keep the record of a cell, if all of it is known; return whether it is."""
        record = self.controlled.find_record(cell)
        if record:
            self._keep(record)
        return record is not None

    def run(self, cells: Sequence[Cell], past: Past) -> None:
        """Bring these cells to their records."""
        self.past = past
        self.order = order(cells, past.seconds)
        self.groups.extend(self._grouped(cells))
        # Controls have a thread of their own: `Runner.measure` waits for claims, and would hold up a slot.
        with threads(self.at_once, self.room.slots, 1) as (self.first, self.second, self.third):
            while self.groups or self.preparing or self.ready or self.probing or self.elsewhere or self.controlling:
                self._prepare()
                self._probe()
                if self.meanwhile and self._has_idle_core():
                    self.meanwhile()
                    self.meanwhile = None
                self._wait()

    def _grouped(self, cells: Sequence[Cell]) -> list[list[Cell]]:
        """Return groups of cells that ask the same of the same Python, those with the longest cells first."""
        groups: dict[tuple[str, str], list[Cell]] = {}
        for cell in sorted(cells, key=lambda cell: self.order[cell.id]):
            groups.setdefault((digest(cell.question, cell.subject), cell.python), []).append(cell)
        return list(groups.values())

    def _has_idle_core(self) -> bool:
        """Return whether the last probes leave a core to others, until they end."""
        return not (self.groups or self.preparing or self.ready) and 0 < len(self.probing) < self.room.slots

    # --- the first stage -------------------------------------------------------------------------------------------

    def _prepare(self) -> None:
        """Take on more groups, while not too many environments wait; but never let slots stay empty."""
        ahead = self.room.slots + self.at_once
        while self.groups and len(self.preparing) < self.at_once:
            if self.ready and len(self.preparing) + len(self.environments) >= ahead:
                break
            self.preparing.add(self.first.submit(list, map(self.runner.prepare, self.groups.popleft())))

    def _arrived(self, prepared: Prepared) -> None:
        if not prepared.claims:
            self._finish(self.runner.probe(prepared))
            return
        cell = prepared.record.cell
        self.runner.observer.step(cell, WAITING)
        self._push(_Ready(self.order[cell.id], prepared, self.past.memory_mb(cell)))

    # --- the second stage ------------------------------------------------------------------------------------------

    def _probe(self) -> None:
        """Fill the free slots with what may start."""
        refused: list[_Ready] = []
        while self.ready and len(self.probing) < self.room.slots:
            ready = self._pop()
            if not self.room.admits(ready.memory_mb, [other.ready.memory_mb for other in self.probing.values()]):
                refused.append(ready)
            else:
                self._start(ready)
        for ready in refused:
            self._push(ready)

    def _start(self, ready: _Ready) -> None:
        """Give a cell a slot, unless the same is being measured already."""
        claims = ready.prepared.claims
        taken = next((name for name in claims if name in self.behind), None)
        if taken is not None:
            self.behind[taken].append(ready)
            return
        try:
            # Never wait here: this thread moves all cells. Those in `elsewhere` are tried again later.
            held = claim([self.runner.store.claim_file(name) for name in claims], wait=False)
        except Exception as error:
            self._fault(ready.prepared.record, error)
            return
        if held is None:
            self.elsewhere.append(ready)
            return
        self.behind.update({name: [] for name in claims})
        self.probing[self.second.submit(self.runner.probe, ready.prepared)] = _Probing(ready, held)

    def _ended(self, future: Future[CellRecord]) -> None:
        probed = self.probing.pop(future)
        probed.claim.release()
        for name in probed.ready.prepared.claims:
            for waiting in self.behind.pop(name):
                self._push(waiting)
        self._finish(future.result())

    # --- controls --------------------------------------------------------------------------------------------------

    def _finish(self, record: CellRecord) -> None:
        """Keep a record, once the controls that it turns on were run."""
        try:
            due = next(self.controlled.due(record), None)
            complete = self.controlled.complete(record) if due is None else record
        except Exception as error:
            self._fault(record, error)
            return
        if due is None:
            self._keep(complete)
        elif due.id in self.held:
            self.held[due.id].append(record)
        else:
            self.held[due.id] = [record]
            self.controlling[self.third.submit(self.controlled.run, due)] = due.id

    def _fault(self, record: CellRecord, error: Exception) -> None:
        """Keep the record of a cell that met an exception which nobody foresaw."""
        phase = Phase.INSTALL if record.lock else Phase.RESOLVE
        # Without a mark the next run does not take this record as it is.
        self._keep(
            replace(stopped_record(record, cell_faults.fault(self.runner, record.cell, phase, error)), mark=None)
        )

    # --- both ------------------------------------------------------------------------------------------------------

    def _wait(self) -> None:
        """Wait until something ended, or until it is time to look again."""
        busy: set[Future[Any]] = {*self.preparing, *self.probing, *self.controlling}
        looking = LOOK_SECONDS if self.elsewhere or self.ready else SIGNAL_SECONDS
        if busy:
            wait(busy, timeout=looking, return_when=FIRST_COMPLETED)
        else:
            time.sleep(LOOK_SECONDS)
        for future in [one for one in self.preparing if one.done()]:
            self.preparing.remove(future)
            for prepared in future.result():
                self._arrived(prepared)
        for probe in [one for one in self.probing if one.done()]:
            self._ended(probe)
        for ran in [one for one in self.controlling if one.done()]:
            ran.result()
            for record in self.held.pop(self.controlling.pop(ran)):
                self._finish(record)
        again, self.elsewhere = self.elsewhere, []
        for ready in again:
            self._push(ready)

    def _push(self, ready: _Ready) -> None:
        heappush(self.ready, ready)
        self.environments[ready.prepared.environment] += 1

    def _pop(self) -> _Ready:
        ready = heappop(self.ready)
        self.environments[ready.prepared.environment] -= 1
        if not self.environments[ready.prepared.environment]:
            del self.environments[ready.prepared.environment]
        return ready

    def _keep(self, record: CellRecord) -> None:
        try:
            self.runner.keep(record)
        except Exception as error:  # the record is told all the same, and measured again in the next run
            self.runner.observer.say(f"{record.cell.id}: it cannot be stored: {error}")
        self.records[record.cell.id] = record
        self.runner.observer.done(record)


def order(cells: Iterable[Cell], seconds: Callable[[Cell], float]) -> dict[str, tuple[float, int, int]]:
    """Return the places of cells by id: the longest first; of equal ones those of other Pythons in turn.

    Two cells of one Python at a time would compile the same files of their shared wheels twice.
    """
    turns = Counter[str]()
    places = {}
    for number, cell in enumerate(cells):
        places[cell.id] = (-seconds(cell), turns[cell.python], number)
        turns[cell.python] += 1
    return places


@contextmanager
def short_turns() -> Iterator[None]:
    """Let the threads of this process take turns more often than Python does by itself."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, SWITCH_SECONDS))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def threads(*sizes: int) -> Iterator[list[ThreadPoolExecutor]]:
    """Yield thread pools; an exception that leaves the block ends them, with every process they started."""
    pools = [ThreadPoolExecutor(max_workers=size, thread_name_prefix="cells") for size in sizes]
    try:
        with short_turns():
            yield pools
    except BaseException:
        for pool in pools:
            # Not waited for yet: the threads wait for processes, which `process.stop` ends.
            pool.shutdown(wait=False, cancel_futures=True)
        process.stop()
        raise
    finally:
        for pool in pools:
            pool.shutdown(wait=True)

"""Measure cells for items: each case once per process, with the phases that the session's items want."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Set
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import chain
from threading import Lock, get_ident

from harness.judging.runs.check import phase_of
from harness.machine import interpreters, process
from harness.machine.store import Store, question_key
from harness.model import CASE_PHASES, Case, Cell, CellRecord, ControlRecord, Phase, replace
from harness.probes import launch
from harness.running.scheduler import (
    ControlledRunner,
    QuietObserver,
    Runner,
    order,
    other_drawing,
    short_turns,
    start_looks,
)
from harness.smoke import judging
from harness.smoke.frozen import SessionPlan

STEPS = frozenset({Phase.RESOLVE, Phase.INSTALL})
ITSELF, SUITE = "", "::suite"
"""What stands in for a case: the cell itself, and its subject's suite; no case is called so."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Selection:
    """The phases and cells that the items of a session stand for.

    `shown` has, by cell and case (empty for the cell itself), the phases with an item of their own; `whole` are the
    cells that are judged, and so measured in full.
    """

    shown: Mapping[tuple[str, str], frozenset[Phase]]
    whole: frozenset[str]

    def phases(self, cell: Cell, case: str = ITSELF) -> frozenset[Phase]:
        """Return the phases of a case, or of the cell itself, that have an item of their own."""
        return self.shown.get((cell.id, case), frozenset())

    def wanted(self, cell: Cell, case: Case) -> frozenset[Phase]:
        """Return the phases of a case to measure: those asked for, and those that they need."""
        if cell.id in self.whole:
            return frozenset(CASE_PHASES)  # of which only those count that checks were asked of
        phases = self.phases(cell, case.id)
        return phases.union(*(judging.needs(phase) for phase in phases))

    def has_items(self, cell: Cell) -> bool:
        """Return whether anything of a cell is asked for."""
        return cell.id in self.whole or any(name == cell.id for name, _ in self.shown)

    def resolved_only(self, cell: Cell) -> bool:
        """Return whether only the lock of the cell is wanted."""
        cases = any(self.phases(cell, case.id) for case in cell.cases)
        return self.phases(cell) == {Phase.RESOLVE} and not cases and cell.id not in self.whole


class Measuring:
    """The measurements of one process. Each part of a cell is measured once, then reused.

    With more than one job, threads measure the cells of all items ahead of these, from the first item on.
    """

    def __init__(self, frozen: SessionPlan, selection: Selection, *, worker: bool, jobs: int = 1) -> None:
        self.store: Store = frozen.store
        self.selection = selection
        self.credit = 0.0  # seconds measured of phases that have an item of their own
        self._frozen = frozen
        self._runner = Runner(self.store, frozen.settings(), QuietObserver())
        self._takes_locks = worker and frozen.fresh
        self._parts: dict[tuple[str, str], Future[CellRecord]] = {}
        self._credited: set[tuple[str, str]] = set()
        self._gate = Lock()
        self._items_thread = get_ident()
        self._threads = ThreadPoolExecutor(jobs, thread_name_prefix="cells") if jobs > 1 else None
        self._ahead: list[Future[None]] = []
        self._turns = ExitStack()
        self._controls: dict[str, ControlRecord] = {}

    def steps(self, cell: Cell) -> CellRecord:
        """Resolve the cell, and install it unless only its lock is wanted. Return the record."""
        until = Phase.RESOLVE if self.selection.resolved_only(cell) else CASE_PHASES[-1]
        return self._measure(cell, ITSELF, replace(cell, cases=()), until)

    def case(self, cell: Cell, case: Case) -> CellRecord:
        """Run the wanted phases of one case in one go, as `run` does. Return the record."""
        return self._measure(cell, case.id, replace(cell, cases=(self._wanted(cell, case),)), CASE_PHASES[-1])

    def suite(self, cell: Cell) -> CellRecord:
        """Run the suite of the cell's subject, after the imports that it needs."""
        cases = tuple(self._wanted(cell, case, {Phase.IMPORT}) for case in cell.cases)
        return self._measure(cell, SUITE, replace(cell, cases=cases), Phase.SUITE)

    def environment(self, cell: Cell) -> tuple[CellRecord, launch.Site | None]:
        """Install the environment of a cell. Return the record and the environment, None if that failed."""
        ready = self._bound(cell, Phase.INSTALL).prepare(replace(cell, cases=()))
        return ready.record, ready.site

    def whole(self, cell: Cell) -> CellRecord:
        """Measure the cell with all its cases, and return the record as `run` stores it."""
        suite = [self.suite(cell)] if has_suite(cell) else []
        cases = [self.case(cell, case) for case in cell.cases]
        record = combine_records(cell, self.steps(cell), cases, suite)
        if not any(other_drawing.due(part) or part.supplied != record.supplied for part in cases):
            return record
        # One set of settings has to draw all cases of a cell: what each drew with alone is stored, and looked up here.
        drawn = self._controlled(cell, Phase.SUITE if suite else CASE_PHASES[-1]).measure(cell)
        return replace(record, cases=drawn.cases, supplied=drawn.supplied, findings=drawn.findings)

    def shown(self, cell: Cell, case: Case) -> frozenset[Phase]:
        """Return the phases whose outcome an item of their own reports, so that no other item has to repeat it."""
        steps = self.selection.phases(cell)
        if steps:
            first, here = judging.collect_phases(self.steps(cell)), judging.collect_phases(self.case(cell, case))
            # A step that ended differently for this case is reported by no other item, so this item has to report it.
            alike = {at for at in STEPS if at in first and at in here and first[at].outcome is here[at].outcome}
            steps &= alike
        return self.selection.phases(cell, case.id) | steps

    def _wanted(self, cell: Cell, case: Case, more: Set[Phase] = frozenset()) -> Case:
        """Return the case with only the checks that this session wants."""
        wanted = self.selection.wanted(cell, case) | more
        return replace(case, checks=tuple(check for check in case.checks if phase_of(check) in wanted))

    def _measure(self, cell: Cell, name: str, part: Cell, until: Phase) -> CellRecord:
        if self._threads and not self._ahead and get_ident() == self._items_thread:
            self._start(self._threads)
        key = cell.id, name
        with self._gate:
            is_new = key not in self._parts
            future = self._parts.setdefault(key, Future())
        if is_new:
            try:
                future.set_result(self._controlled(cell, until).measure(part))
            except BaseException as error:
                # Not kept: the next item that needs it tries again.
                del self._parts[key]
                future.set_exception(error)
        record = future.result()
        if get_ident() == self._items_thread and key not in self._credited:
            self._credited.add(key)
            self.credit += self._shown_seconds(cell, name, record)
        return record

    def _start(self, threads: ThreadPoolExecutor) -> None:
        """Let threads measure all cells that have items; those of other Pythons in turn, as `run` does.

        What makes the report comes last: it is imported when a thread has nothing more to measure.
        """
        self._turns.enter_context(short_turns())
        start_looks(self.store)
        cells = [cell for cell in self._frozen.cells if self.selection.has_items(cell)]
        places = order(cells, lambda _: 0.0)
        for cell in sorted(cells, key=lambda cell: places[cell.id]):
            self._ahead.append(threads.submit(self._measure_ahead, cell))
        threads.submit(self._load_report)

    def _load_report(self) -> None:
        """Get ready for a report that has to be made, if anything was measured again."""
        with suppress(Exception):
            ended = [future for future in self._parts.values() if future.done()]
            if self.selection.whole and not all(future.result().reused for future in ended):
                from harness.reports import publishing  # noqa: PLC0415 - start-up

                publishing.load(self._frozen.plans)

    def _measure_ahead(self, cell: Cell) -> None:
        """Measure the steps and cases of a cell that items will ask for. What fails is tried again for its item."""
        with suppress(Exception):
            self.steps(cell)
            for case in cell.cases:
                if cell.id in self.selection.whole or self.selection.phases(cell, case.id):
                    self.case(cell, case)

    def close(self) -> None:
        """Measure no more: end what is still measured ahead, where pytest stops before all items have run."""
        if self._threads is None:
            return
        self._threads.shutdown(wait=False, cancel_futures=True)
        if not all(future.done() for future in self._ahead):
            process.stop()
        self._threads.shutdown()
        self._turns.close()

    def _shown_seconds(self, cell: Cell, name: str, record: CellRecord) -> float:
        """Return the seconds of those phases in a record that have an item of their own."""
        results = judging.collect_suite(record) if name == SUITE else judging.collect_phases(record)
        own = {ITSELF: STEPS, SUITE: {Phase.SUITE}}.get(name, frozenset(CASE_PHASES))
        shown = own & self.selection.phases(cell, ITSELF if name == SUITE else name)
        return sum(results[at].seconds for at in shown if at in results)

    def _controlled(self, cell: Cell, until: Phase) -> ControlledRunner:
        return ControlledRunner(self._bound(cell, until), self._controls)

    def _bound(self, cell: Cell, until: Phase) -> Runner:
        """Return a runner that stops after a phase. All such runners share their results."""
        runner = replace(self._runner, settings=self._frozen.settings(until))
        if self._takes_locks:
            self._take_lock(runner, cell)
        return runner

    def _take_lock(self, runner: Runner, cell: Cell) -> None:
        """Let a worker reuse the lock that the controller has just made, even if all else is measured afresh."""
        interpreter = interpreters.obtain(cell.python, offline=self._frozen.offline)
        if interpreter and cell.subject is None:  # with a subject another question is asked, which is its own
            reusing_runner = Runner(self.store, replace(runner.settings, fresh=False), QuietObserver())
            answer = reusing_runner.lock_of(cell, interpreter)
            runner.resolved.setdefault(question_key(cell.question, interpreter), answer)


def has_suite(cell: Cell) -> bool:
    """Return whether the cell has a package under test with a suite of its own."""
    return cell.subject is not None and cell.subject.suite is not None


def combine_records(
    cell: Cell, steps: CellRecord, cases: Iterable[CellRecord], suite: Iterable[CellRecord]
) -> CellRecord:
    """Return one record of all parts, based on the steps, or on the first part whose install ended differently."""
    case_parts, last = tuple(cases), tuple(suite)
    parts = (*case_parts, *last)
    other = (one for one in parts if (one.install and one.install.outcome) != (steps.install and steps.install.outcome))
    base = next(other, steps)
    case_records = tuple(chain.from_iterable(one.cases for one in case_parts))
    tested = next((one.suite for one in last), None)
    probed = [phase for case in case_records for phase in case.phases if phase.measured]
    probed += [tested] if tested and tested.measured else []
    step_records = [step for step in (steps.resolve or base.resolve, base.install) if step]
    return replace(
        base,
        cell=cell,
        resolve=steps.resolve or base.resolve,
        cases=case_records,
        suite=tested,
        controls={api: one for part in parts for api, one in part.controls.items()},
        measured=max((phase.measured for phase in probed if phase.measured), default=base.measured),
        reused=bool(step_records) and all(one.reused for one in step_records) and all(phase.reused for phase in probed),
        seconds=round(sum(one.seconds for one in step_records) + sum(phase.seconds for phase in probed), 3),
    )

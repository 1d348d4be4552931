"""Measure cells for a search, within bounds. Stored results are reused; likely next cells are prepared meanwhile."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Self

from harness.judging.assess import Assessed, assess
from harness.judging.identity import Failure
from harness.machine import interpreters, process, this_machine
from harness.machine.store import Store, cache_folder
from harness.model import CASE_PHASES, Cell, CellRecord, ControlRecord, Outcome, Phase, Verdict, replace
from harness.packages import locks
from harness.running.scheduler import ControlledRunner, Observer, QuietObserver, Runner, Settings, StepObserver, steps
from harness.running.scheduler.shared_environment import Pool
from harness.running.signatures import shipped_signatures


class BudgetExhausted(Exception):
    """The runs or minutes that were allowed are used up."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Bounds:
    """Limits of a search: the number of measured cells, and the minutes; None means no limit."""

    runs: int | None = None
    minutes: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """One measured cell. `seconds` is wall-clock time, `at_hand` is true if nothing had to be run for it.

    `failure` is the failure of the cell, read before another measurement of the cell overwrites the logs. `lock` is its
    lock; None if it did not resolve.
    """

    assessed: Assessed
    failure: Failure | None
    seconds: float
    at_hand: bool
    lock: Path | None = None

    @property
    def record(self) -> CellRecord:
        """Return the record of the cell."""
        return self.assessed.record

    @property
    def cell(self) -> Cell:
        """Return the cell as it was measured."""
        return self.assessed.record.cell

    @property
    def versions(self) -> dict[str, str]:
        """Return the packages in the lock with their versions; empty without a lock."""
        pins = locks.read_pins(self.lock.read_text(encoding="utf-8")) if self.lock else {}
        return {name: version for name, (version, _) in pins.items()}

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return the lines that say why the cell failed."""
        return tuple(text for one in self.assessed.failures for text in one.reasons)

    @property
    def works(self) -> bool:
        """Return whether everything requested passed, and no silent issue is left open."""
        return self.assessed.fulfilled

    @property
    def doubtful(self) -> bool:
        """Return whether the cell works except for a silent issue that no check has refuted."""
        return self.assessed.verdict is Verdict.WORKS and not self.works

    @property
    def bad(self) -> bool:
        """Return whether the cell fails, misleads, or may mislead."""
        return self.failure is not None or self.doubtful

    @property
    def success_text(self) -> str:
        """Return the words for a cell that does everything requested. Import alone is never called `works`."""
        if self.assessed.verdict is Verdict.WORKS:
            return str(Verdict.WORKS)
        passed = [phase for phase in CASE_PHASES if self.assessed.phases.get(phase) is Outcome.PASSED]
        return f"passes {' and '.join(passed)}, all that was requested"

    @property
    def failure_text(self) -> str:
        """Return the words for a cell that does not do everything requested."""
        return f"{self.assessed.verdict}: {self.assessed.decisive or 'no line of the output explains it'}"

    @property
    def untold(self) -> bool:
        """Return whether the result says nothing about the packages: this machine or the network was at fault."""
        return self.assessed.untold and not self.works


@dataclass
class Bench:
    """The place where the cells of a search are measured, one at a time. Use it in a `with` block.

    `settings.until` is the last phase that matters. `trials` holds the result of each call of `measure` in order, those
    at hand included. `built` holds the keys of the environments that had to be built.
    """

    store: Store
    settings: Settings
    observer: Observer
    bounds: Bounds = Bounds()
    trials: list[Trial] = field(default_factory=list, init=False)
    built: set[str] = field(default_factory=set, init=False)

    def __post_init__(self) -> None:
        self.store.save_machine(this_machine.facts().id, this_machine.facts().facts)
        self.began = monotonic()
        self._runner = self._make_runner(self.settings)
        self._ahead = ThreadPoolExecutor(1)
        self._controls: dict[str, ControlRecord] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # `shutdown` waits for the preparation under way; without `stop` an interrupted search waits for its install.
        if error:
            process.stop()
        self._ahead.shutdown(cancel_futures=True)

    def at_hand(self, cell: Cell) -> Trial | None:
        """Return the stored result of a cell, uncounted and whatever the bounds; None if something has to be run."""
        began = monotonic()
        record = self._controlled(self._runner).find_record(cell)
        return self._trial(record, began, at_hand=True) if record else None

    def measure(self, cell: Cell, *, again: bool = False, keep: bool = False, whole: bool = False) -> Trial:
        """Measure a cell, or take its stored result. `again` runs its probes again with the same lock.

        `keep` stores the record so that `show` finds it. `whole` measures all phases. Raises Spent.
        """
        began = monotonic()
        settings = replace(self.settings, until=Phase.SUITE) if whole else self.settings
        runner = self._runner if settings == self.settings else self._make_runner(settings)
        stored_record = None if again else self._controlled(runner).find_record(cell)
        if stored_record is None:
            self._within()
            # `fresh`, because the setting `again` repeats failures only, and a flaky cell may have passed.
            # A new runner, because within one runner no run is made a second time.
            runner = self._make_runner(replace(settings, fresh=True)) if again else runner
            self.observer.started(cell)
            record = self._controlled(runner).measure(cell)
            self.built |= {one.key for one in runner.environments.values() if not one.reused}
        else:
            record = stored_record
        if keep:
            self._runner.keep(record)
        self.observer.done(record)
        trial = self._trial(record, began, at_hand=stored_record is not None)
        self.trials.append(trial)
        return trial

    def prepare(self, cells: Iterable[Cell]) -> None:
        """Resolve and install cells in the background, so that measuring them finds their environments."""
        for cell in cells:
            self._ahead.submit(self._prepare, cell)

    def _prepare(self, cell: Cell) -> None:
        if not process.is_stopped() and self._controlled(self._runner).find_record(cell) is None:
            replace(self._runner, observer=QuietObserver(self.observer)).prepare(cell)

    def stop_after(self, phase: Phase) -> None:
        """Ignore all phases after this one from now on."""
        self.settings = replace(self.settings, until=phase)
        self._runner = self._make_runner(self.settings)

    def has_environment(self, cell: Cell) -> bool:
        """Return whether the environment of a cell exists already, so that only its probes have to run."""
        interpreter = interpreters.find(cell.python)
        # The question of a cell with a subject needs the wheel of that subject, which may have to be built first.
        if interpreter is None or cell.subject is not None:
            return False
        try:
            lock, _ = steps.peek(self._runner.lock(cell.question, interpreter))
        except steps.Unknown:
            return False
        environment = Pool(self._runner, cell, lock, interpreter).load_install() if lock else None
        # The stored result of an install outlasts its environment, which `gc` may have removed.
        return (
            environment is not None
            and environment.key is not None
            and (cache_folder() / "environments" / environment.key).is_dir()
        )

    @property
    def runs(self) -> int:
        """Return how many cells were really measured."""
        return sum(not trial.at_hand for trial in self.trials)

    @property
    def seconds(self) -> float:
        """Return how long it has taken so far."""
        return monotonic() - self.began

    @property
    def mean_seconds(self) -> float | None:
        """Return the mean duration of a measured cell; None before the first was measured."""
        measured = [trial.seconds for trial in self.trials if not trial.at_hand]
        return sum(measured) / len(measured) if measured else None

    def _within(self) -> None:
        if self.bounds.runs is not None and self.runs >= self.bounds.runs:
            message = f"{self.bounds.runs} runs are used up"
            raise BudgetExhausted(message)
        if self.bounds.minutes is not None and monotonic() - self.began > self.bounds.minutes * 60:
            message = f"{self.bounds.minutes:g} minutes are used up"
            raise BudgetExhausted(message)

    def _make_runner(self, settings: Settings) -> Runner:
        return Runner(self.store, settings, StepObserver(self.observer))

    def _controlled(self, runner: Runner) -> ControlledRunner:
        return ControlledRunner(runner, self._controls)

    def _trial(self, record: CellRecord, began: float, *, at_hand: bool) -> Trial:
        assessed = assess(record, shipped_signatures.load_knowledge(self.store.folder))
        return Trial(
            assessed=assessed,
            failure=assessed.failure,
            lock=self.store.folder / record.lock if record.lock else None,
            seconds=round(monotonic() - began, 3),
            at_hand=at_hand,
        )

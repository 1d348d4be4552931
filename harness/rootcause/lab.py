"""Changed cells measured for a repair: each with the change that made it, why it was tried, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from time import monotonic
from types import TracebackType
from typing import Self

from harness import changes, knowledge, moves
from harness.evidence import failures
from harness.model import FAILING, Cell, Change, Outcome, Phase, Repair, Tried, Verdict
from harness.rootcause.bench import Bench, Bounds, Trial
from harness.scheduler import Observer, Settings
from harness.signatures import Evidence
from harness.store import Store
from harness.verdict import case_phases
from harness.vocabulary import LONGEST_LABEL, WITH

ORDER = list(Phase)


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """One changed cell as it was measured, up to a phase: the last one, unless a search needs no more."""

    change: Change
    why: str
    trial: Trial
    until: Phase


@dataclass
class Lab:
    """Where changes of one cell are tried; use it in a `with` block. `base` is the cell as it is asked for."""

    base: Cell
    store: Store
    settings: Settings
    observer: Observer
    bounds: Bounds
    recipes: Mapping[str, tuple[Repair, ...]]
    runs: list[Run] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.bench = Bench(self.store, self.settings, self.observer, self.bounds)
        self.until = self.settings.until

    def __enter__(self) -> Self:
        self.bench.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bench.__exit__(kind, error, trace)

    @property
    def measured(self) -> int:
        """How many cells were really run."""
        return sum(not one.trial.at_hand for one in self.runs)

    @property
    def seconds(self) -> float:
        """How long it has taken so far."""
        return monotonic() - self.bench.began

    def cell(self, change: Change) -> Cell:
        """The cell with a change. Raises ValueError where no recipe repairs a package of its overlay."""
        if moves.empty(change):
            return self.base
        made = changes.applied(self.base, change, self.recipes)
        tried = Tried(name="repair", reason="a remedy is looked for", change=change, proving=True)
        return replace(
            made,
            id=f"{self.base.matrix}/{_label(self.base, change)}",
            base=self.base.id,
            tried=tried,
            expect=None,
        )

    def same(self, one: Change, other: Change) -> bool:
        """Whether two changes make the same cell. Raises ValueError as `cell` does."""
        return changes.same(self.cell(one), self.cell(other))

    def measure(self, change: Change, why: str, *, again: bool = False) -> Trial:
        """Measure the cell with a change, or take what is known of it. Raises Spent, and ValueError as `cell` does."""
        cell = self.cell(change)
        before = next((one.trial for one in self.runs if one.change == change and self._tells(one)), None)
        if before and not again:
            return before
        trial = self.bench.measure(cell, again=again)
        self.runs.append(Run(change=change, why=why, trial=trial, until=self.until))
        self.observer.say(f"run {len(self.runs)}: {why}: {ended(trial, self.until)} ({trial.seconds:.1f} s)")
        return trial

    def _tells(self, run: Run) -> bool:
        """Whether a run says what one up to the present phase would: it was one, or it failed before."""
        return run.until is self.until or not passes(run.trial, run.until)

    @contextmanager
    def up_to(self, phase: Phase) -> Iterator[None]:
        """While the block lasts, cells are measured up to a phase."""
        last = self.until
        if phase is not last:
            self.bench.stop_after(phase)
        self.until = phase
        try:
            yield
        finally:
            self.until = last
            if phase is not last:
                self.bench.stop_after(last)

    def prepare(self, *wanted: Change) -> None:
        """Resolve and install changed cells in the background."""
        self.bench.prepare([self.cell(one) for one in wanted])

    def shown(self, trial: Trial) -> Trial | None:
        """The run of this session in which what a cell came to was measured: its own, or one with the same lock."""
        if not trial.at_hand:
            return trial
        lock, python = trial.record.lock_sha256, trial.record.python
        whole = (one.trial for one in reversed(self.runs) if one.until is self.until)
        alike = (one for one in whole if not one.at_hand and one.works)
        return next((one for one in alike if (one.record.lock_sha256, one.record.python) == (lock, python)
                     and one.cell.environment == trial.cell.environment), None)  # fmt: skip

    def keep(self, trial: Trial) -> None:
        """Store the record of a cell, so that `show` knows it."""
        self.store.save_cell(trial.record)

    def evidence(self, trial: Trial) -> tuple[Evidence, ...]:
        """What was written of its failures."""
        return tuple(failures(trial.record, knowledge.beside(self.store.folder).logs))


def _label(cell: Cell, change: Change) -> str:
    digest = sha256(repr(sorted(changes.plain(change).items())).encode()).hexdigest()[:8]
    ending = f"{WITH}repair-{digest}"
    return f"{cell.label[: LONGEST_LABEL - len(ending)]}{ending}"


# --- what came of it -------------------------------------------------------------------------------------------


def weaker(before: Trial, after: Trial) -> str | None:
    """Why a cell that works shows less than was asked of the one before: a check that failed or passed is left out."""
    ended = _checks(after)
    for (case, check), outcome in _checks(before).items():
        if outcome in {*FAILING, Outcome.PASSED} and ended.get((case, check)) is not Outcome.PASSED:
            now = ended.get((case, check), Outcome.NOT_REACHED)
            return f"{check} of {case} was {outcome} before and is {now} now"
    for phase in after.judged.unverified:
        if before.judged.phases.get(Phase(phase)) in {*FAILING, Outcome.PASSED}:
            return f"{phase} could not be verified"
    return None


def _checks(trial: Trial) -> dict[tuple[str, str], Outcome]:
    return {
        (case.case, check.check): check.outcome
        for case in trial.record.cases
        for phase in case_phases(trial.record, case)
        for check in phase.checks
    }


def passes(trial: Trial, until: Phase) -> bool:
    """Whether a cell that was measured up to a phase came through it."""
    if trial.works:
        return True
    if trial.judged.verdict is not Verdict.NOT_RUN:
        return False
    reached = ORDER[: ORDER.index(until) + 1]
    ended = {trial.judged.phases[phase] for phase in reached if phase in trial.judged.phases}
    return Outcome.PASSED in ended and ended <= {Outcome.PASSED, Outcome.SKIPPED}


def ended(trial: Trial, until: Phase) -> str:
    """How a run ended, in a few words."""
    if passes(trial, until) and until is not Phase.SUITE:
        return f"passes {until}"
    if trial.works:
        return trial.well
    failed = f" in {trial.judged.phase}" if trial.judged.phase else ""
    return f"{trial.judged.verdict}{failed}"


def further(before: Trial, after: Trial) -> bool:
    """Whether a cell fails of something else than the one before, and not earlier."""
    one, other = before.failure, after.failure
    if one is None or other is None or one.same(other):
        return False
    places = [ORDER.index(each.phase) if each.phase else 0 for each in (one, other)]
    return places[1] >= places[0]

"""Measure changed cells for a repair: each with its change, the reason to try it, and its result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from packaging.version import Version

from harness.judging.identity import Failure
from harness.machine.store import Store
from harness.matrix import changes
from harness.model import FAILING, Cell, Change, Outcome, Phase, Repair, Tried, Verdict, cellid, replace
from harness.model.vocabulary import MISLEADING
from harness.rootcause.bench import Bench, Bounds, Trial
from harness.rootcause.repair import candidate_changes, failure_hints
from harness.running.scheduler import Observer, Settings
from harness.standalone.failures.silent import PREFIX

ORDER = list(Phase)


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """One changed cell as it was measured, up to a phase: the last one, unless a search needs less."""

    change: Change
    why: str
    trial: Trial
    until: Phase


@dataclass
class Lab:
    """The place where changes of one cell are tried. Use it in a `with` block. `base` is the unchanged cell."""

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

    def cell(self, change: Change) -> Cell:
        """Return the cell with a change. Raises ValueError if no recipe repairs a package of its overlay."""
        if not change:
            return self.base
        changed_cell = changes.apply(self.base, change, self.recipes)
        tried = Tried(name="repair", reason="a remedy is looked for", change=change, proving=True)
        name = f"repair-{cellid.digest(repr(sorted(change.plain.items())))}"
        cell_id = changes.id_of(self.base, name, change)
        return replace(changed_cell, id=cell_id, base=self.base.id, tried=tried, expect=None)

    def same(self, first: Change, other: Change) -> bool:
        """Return whether two changes make the same cell. Raises ValueError as `cell` does."""
        return changes.same(self.cell(first), self.cell(other))

    def measure(self, change: Change, why: str, *, again: bool = False) -> Trial:
        """Measure the cell with a change, or take its stored result. Raises Spent, and ValueError as `cell` does."""
        cell = self.cell(change)
        for run in self.runs if not again else ():
            # A run says as much as one up to the present phase if it went as far, or failed before.
            if run.change == change and (run.until is self.until or not passes(run.trial, run.until)):
                return run.trial
        trial = self.bench.measure(cell, again=again)
        self.runs.append(Run(change=change, why=why, trial=trial, until=self.until))
        self.observer.say(f"run {len(self.runs)}: {why}: {describe_result(trial, self.until)} ({trial.seconds:.1f} s)")
        return trial

    @contextmanager
    def up_to(self, phase: Phase) -> Iterator[None]:
        """Measure cells only up to a phase while the block lasts."""
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
        """Return the run of this session that shows a result: the trial itself, or a working one with the same lock.

        None if there is no such run.
        """
        if not trial.at_hand:
            return trial
        lock, python = trial.record.lock_sha256, trial.record.python
        whole = (one.trial for one in reversed(self.runs) if one.until is self.until)
        alike = (one for one in whole if not one.at_hand and one.works)
        return next((one for one in alike if (one.record.lock_sha256, one.record.python) == (lock, python)
                     and one.cell.environment == trial.cell.environment), None)  # fmt: skip


# --- what came of it -------------------------------------------------------------------------------------------


def find_lost_check(before: Trial, after: Trial) -> str | None:
    """Return why a working cell shows less than the one before: a check that ran there does not pass now; else None."""
    ended = _checks(after)
    for (case, check), outcome in _checks(before).items():
        if check in MISLEADING and outcome is Outcome.PASSED and ended.get((case, check)) is Outcome.SKIPPED:
            continue  # it has no meaning there, such as that of a free camera where the model's own is drawn with
        if outcome in {*FAILING, Outcome.PASSED} and ended.get((case, check)) is not Outcome.PASSED:
            now = ended.get((case, check), Outcome.NOT_REACHED)
            return f"{check} of {case} was {outcome} before and is {now} now"
    for phase in (name for name in after.assessed.unverified if not name.startswith(PREFIX)):
        if before.assessed.phases.get(Phase(phase)) in {*FAILING, Outcome.PASSED}:
            return f"{phase} could not be verified"
    return None


def _checks(trial: Trial) -> dict[tuple[str, str], Outcome]:
    return {(case.record.case, check.check): check.outcome for case in trial.assessed.cases for check in case.checks}


def passes(trial: Trial, until: Phase) -> bool:
    """Return whether a cell that was measured up to a phase passed it."""
    if trial.works:
        return True
    # A run that was to stop early is `not_run` if nothing failed before.
    if trial.assessed.verdict is not Verdict.NOT_RUN:
        return False
    reached = ORDER[: ORDER.index(until) + 1]
    ended = {trial.assessed.phases[phase] for phase in reached if phase in trial.assessed.phases}
    return Outcome.PASSED in ended and ended <= {Outcome.PASSED, Outcome.SKIPPED}


def describe_result(trial: Trial, until: Phase) -> str:
    """Return the result of a run in a few words."""
    if passes(trial, until) and until is not Phase.SUITE:
        return f"passes {until}"
    if trial.works:
        return trial.success_text
    if trial.doubtful:
        return f"works, not verified: {', '.join(trial.assessed.unverified)}"
    failed = f" in {trial.assessed.phase}" if trial.assessed.phase else ""
    return f"{trial.assessed.verdict}{failed}"


def fails_further(before: Trial, after: Trial) -> bool:
    """Return whether a cell fails differently from the one before, and not in an earlier phase.

    Two messages of the resolver about the same packages are one failure, however they are worded.
    """
    failure, other = before.failure, after.failure
    if failure is None or other is None or failure.same(other):
        return False
    if failure.phase is other.phase is Phase.RESOLVE:
        return _conflicts(failure).isdisjoint(_conflicts(other)) and bool(_conflicts(other))
    places = [ORDER.index(each.phase) if each.phase else 0 for each in (failure, other)]
    return places[1] >= places[0]


def _conflicts(failed: Failure) -> frozenset[str]:
    return failure_hints.subjects(failed.line)


def find_unenforced_bound(before: Trial, after: Trial) -> str | None:
    """Return why a cell works only because an older release does not reject a version yet; None if it is not so."""
    had = before.versions or candidate_changes.pins(before.cell)
    has = after.versions
    for name, bound in failure_hints.find_unmet_bounds(before.reasons, had).items():
        version = has.get(name)
        if version is None or bound.contains(version, prereleases=True):
            continue
        for other in had.keys() & has.keys() - {name}:
            if Version(has[other]) < Version(had[other]):
                requirement = f"{name}{failure_hints.format_bound(bound)}"
                return f"the error asks for {requirement}, and {other} {has[other]} is too old to know that"
    return None

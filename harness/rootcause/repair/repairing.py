"""Find the smallest change that turns a red cell green, by experiment, and prove it by a rerun (`repair`).

The cheapest untried change is tried next; of equally cheap ones, the one on top of a change that revealed another
failure. A change that cures is made smaller, each part of it is left out once, and the whole is measured in every
phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from heapq import heappop, heappush
from itertools import count

from harness.machine import interpreters
from harness.model import Change, Phase, Verdict
from harness.model.report_types import format_count
from harness.model.vocabulary import required_name
from harness.rootcause import search
from harness.rootcause.bench import BudgetExhausted, Trial
from harness.rootcause.repair import candidate_changes, narrowing, stages, widening
from harness.rootcause.repair.candidate_changes import Move, Way, merge_changes
from harness.rootcause.repair.lab import (
    Lab,
    describe_result,
    fails_further,
    find_lost_check,
    find_unenforced_bound,
)
from harness.rootcause.repair.narrowing import Narrowing
from harness.rootcause.repair.stages import STAGES, Place
from harness.rootcause.search import Answer
from harness.standalone.failures.remedies import in_words

DEEPEST = 4
"""Changes on top of each other, each for a failure that showed behind the one before."""


FEW = 4
"""Parts that are not needed and are listed by name."""


class Status(StrEnum):
    """The outcome of a repair."""

    FOUND = "found"
    NOT_FOUND = "not found"
    STOPPED = "stopped short"
    GREEN = "green already"
    UNTOLD = "could not tell"


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """A part of a remedy, and the cell without it, which has to fail; None if that could not be shown."""

    change: Change
    without: Trial | None


@dataclass(frozen=True, kw_only=True, slots=True)
class RepairResult:
    """The result of a repair. `change` is the remedy, `proof` the cell with it.

    `moved` are packages that the user had bounded. `stopped` says why the search ended early, `left` what was not
    tried, `bound` how many tests its binary searches need at most, `notes` what was learned on the way.
    """

    status: Status
    before: Trial
    change: Change | None = None
    way: Way | None = None
    why: str = ""
    parts: tuple[Part, ...] = ()
    proof: Trial | None = None
    moved: tuple[str, ...] = ()
    stopped: str | None = None
    left: tuple[str, ...] = ()
    bound: int = 0
    notes: tuple[str, ...] = ()


@dataclass(order=True)
class _Entry:
    """A stage to go through at a place. Of two stages of equal cost, the one at the deeper place is first."""

    cost: float
    above: int
    number: int
    place: Place = field(compare=False)
    way: Way = field(compare=False)


@dataclass
class _Cure:
    """A change that cures, while it is made as small as possible."""

    change: Change
    move: Move
    trial: Trial
    proven: bool = False
    parts: tuple[Part, ...] = ()


class Search:
    """One repair in a lab."""

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.queue: list[_Entry] = []
        self.opened: set[tuple[str, tuple[tuple[str, str], ...]]] = set()
        self.numbers = count()
        self.now: _Entry | None = None
        self.cure: _Cure | None = None
        self.notes: list[str] = []
        self.bound = 0
        self.flaky = False

    def run(self) -> RepairResult:
        """Measure the cell, and search for a change that cures it. Never raises Spent."""
        before = self.lab.measure(Change(), "as it is asked for")
        self.before = before
        if before.works or before.doubtful:
            return RepairResult(status=Status.GREEN, before=before)
        if before.failure is None:
            return RepairResult(status=Status.UNTOLD, before=before)
        stopped = None
        try:
            self._open(Change(), before, 0)
            self._look()
            if self.cure:
                self._settle(self.cure)
                self._stands()
        except BudgetExhausted as spent:
            stopped = str(spent)
        return self._answer(stopped)

    def proven(self, change: Change) -> RepairResult | None:
        """Return the repair by a change that cured another cell; None if it does not cure this one."""
        self.before = self.lab.measure(Change(), "as it is asked for")
        move = Move(change=change, way=Way.SIGNATURE, why="it cured another cell of the same cause")
        try:
            trial = self.lab.measure(change, move.why)
            if not trial.works or self._no_cure(self.before, trial):
                return None
            self.cure = _Cure(change=change, move=move, trial=trial)
            self._least(self.cure)
            self.cure.proven = True
            self._stands()
        except (BudgetExhausted, ValueError):
            # A remedy of another cell that cannot be tried here decides nothing: `every` goes on with a search.
            return None
        return self._answer(None)

    # --- looking ---------------------------------------------------------------------------------------------------

    def _open(self, change: Change, trial: Trial, depth: int, ways: Iterable[Way] = STAGES) -> None:
        """Queue the stages to try at a place.

        A failure in the same environment and with the same variables is gone into once, whatever change led there.
        """
        key = trial.record.key
        if key:
            measured = (key, tuple(sorted(change.environment.items())))
            if measured in self.opened:
                return
            self.opened.add(measured)
        phase = trial.failure.phase if trial.failure else None
        place = Place(lab=self.lab, change=change, trial=trial, phase=phase or Phase.SUITE)
        for way in ways:
            heappush(self.queue, _Entry(candidate_changes.COSTS[way], -depth, next(self.numbers), place, way))

    def _look(self) -> None:
        while self.queue and self.cure is None:
            self.now = heappop(self.queue)
            for move in STAGES[self.now.way](self.now.place):
                if self._cures(self.now, move):
                    return
        self.now = None

    def _cures(self, entry: _Entry, move: Move) -> bool:
        """Try one change and return whether it cures. If it reveals another failure, queue the stages for that."""
        place = entry.place
        change = merge_changes(place.change, stages.add_guard(place, move))
        try:
            if self.lab.same(change, place.change):
                return False
            trial = self.lab.measure(change, move.why)
        except ValueError:
            # No recipe here repairs a package of the overlay; the next move is tried.
            return False
        if trial.works:
            reason = self._no_cure(place.trial, trial)
            if reason:
                self.notes.append(f"{move.why}: {reason}")
                return False
            self.cure = _Cure(change=change, move=move, trial=trial)
            return True
        depth = 1 - entry.above
        if trial.doubtful:
            self.notes.append(f"{move.why}: {describe_result(trial, self.lab.until)}")
            # Nothing failed, so there is no error to go by: only the remedy of the open silent issue may help.
            self._open(change, trial, depth, (Way.SIGNATURE,))
        elif depth < DEEPEST and fails_further(place.trial, trial):
            self._open(change, trial, depth)
        return False

    def _no_cure(self, before: Trial, trial: Trial) -> str | None:
        """Return why a working cell is no remedy all the same; None if it is one."""
        less = find_lost_check(self.before, trial)
        return f"{less}, which is a weaker test" if less else find_unenforced_bound(before, trial)

    # --- making it smaller -----------------------------------------------------------------------------------------

    def _settle(self, cure: _Cure) -> None:
        """Make the remedy smaller: bounds instead of a date or a lock, no guard of the search, no unneeded part."""
        by_pins = cure.move.way is Way.PINS and len(cure.move.change.requirements) == 1
        cure.change = (self._nearest(cure) if by_pins else self._narrowed(cure)) or cure.change
        self._unguarded(cure)
        # Parts are left out first, so that no bound is widened that is not needed at all.
        self._least(cure)
        self._widened(cure)
        # A stored result is no proof: `sufficient` in the document promises a run of this session.
        if self.lab.shown(cure.trial) is None:
            cure.trial = self.lab.measure(cure.change, "the whole remedy once more", again=True)
        cure.proven = cure.trial.works and self._no_cure(self.before, cure.trial) is None

    def _take(self, cure: _Cure, change: Change, why: str) -> bool:
        """Measure a smaller change, adopt it if it cures in every phase, and return whether it does."""
        trial = self.lab.measure(change, why)
        if not trial.works or self._no_cure(self.before, trial):
            return False
        cure.change, cure.trial = change, trial
        return True

    def _unguarded(self, cure: _Cure) -> None:
        """Let big packages be built again, where the remedy itself does not forbid it."""
        whole = stages.remove_guard(cure.change, cure.move.change.only_binary)
        if whole != cure.change:
            self._take(cure, whole, "without the guard against long builds")

    def _narrowed(self, cure: _Cure) -> Change | None:
        """Return the fewest packages with their bounds, in place of a date, a lock or all build requirements.

        None if no such bounds cure.
        """
        broad_change = cure.move.change
        if cure.move.way not in {Way.DATE, Way.LOCK, Way.BUILDS}:
            broad_change = Change(as_of=cure.change.as_of)
        if not broad_change:
            return None
        rest = candidate_changes.without(cure.change, broad_change)
        failing = self.lab.measure(rest, "without it") if stages.remove_guard(rest) else self.before
        if failing.failure is None:
            return None
        tools = stages.tools(failing.cell, cure.change, offline=self.lab.settings.offline)
        in_build = failing.failure.phase is Phase.INSTALL
        suspects = (*(tools if in_build else ()), *narrowing.differing(self.lab.base, cure.trial, failing))
        search = Narrowing(self.lab, rest, failing, interpreters.find(failing.cell.python))
        # Runs up to the failed phase are shorter; the search over all phases follows only if that gives no cure.
        phases = dict.fromkeys((failing.failure.phase or Phase.SUITE, Phase.SUITE))
        try:
            return next((change for phase in phases if (change := self._up_to(phase, cure, search, suspects))), None)
        finally:
            self.bound += search.bound
            self.notes += search.notes

    def _up_to(
        self, phase: Phase, cure: _Cure, search: Narrowing, suspects: Sequence[narrowing.Suspect]
    ) -> Change | None:
        """Return the bounds that cure, searched up to a phase; None if there are none, or a later phase fails."""
        search.bound, search.notes = 0, []
        with self.lab.up_to(phase):
            chosen = search.fewest(suspects)
            bounds = search.bounded(chosen) if chosen else None
        if chosen is None or bounds is None:
            return None
        if self._take(cure, stages.remove_guard(merge_changes(search.rest, bounds)), "bounded, in every phase"):
            return cure.change
        exact = merge_changes(search.rest, narrowing.hold_packages(chosen))
        pinned = phase is Phase.SUITE and self._take(cure, exact, "pinned, in every phase")
        return cure.change if pinned else None

    def _widened(self, cure: _Cure) -> None:
        """Widen the bounds of a known remedy to keep all releases that work."""
        if cure.move.way is not Way.SIGNATURE:
            return
        widened = widening.Widening(self.lab, cure.change, self.before, cure.trial)
        change = widened.run()
        self.bound += widened.bound
        self.notes += widened.notes
        if change != cure.change and self._take(cure, change, "with the widest bounds, in every phase"):
            self._least(cure)

    def _nearest(self, cure: _Cure) -> Change | None:
        """Return the change to the working release nearest to the one that the user pins; None if there is none."""
        (line,) = cure.move.change.requirements
        name, pinned = required_name(line), candidate_changes.pins(self.lab.base)
        good = cure.trial.versions.get(name)
        if name not in pinned or good is None:
            return None
        rest = candidate_changes.without(cure.change, cure.move.change)
        search = Narrowing(self.lab, rest, self.before, interpreters.find(cure.trial.cell.python))
        suspect = narrowing.Suspect(name=name, good=good, bad=pinned[name], required=True)
        change = merge_changes(rest, search.bounded([suspect]))
        self.bound += search.bound
        self.notes += search.notes
        return (
            cure.change
            if self._take(cure, stages.remove_guard(change), "the nearest that works, in every phase")
            else None
        )

    def _least(self, cure: _Cure) -> None:
        """Leave out parts by halves as long as the cell works, then measure it without each part that stays."""
        whole = candidate_changes.parts(cure.change)
        needed = search.minimise(whole, self._keeping).items if len(whole) > 1 else whole
        if needed is not None and len(needed) < len(whole):
            spare = [in_words(part.plain) for part in whole if part not in needed]
            more = f" and {len(spare) - FEW} more" if len(spare) > FEW else ""
            self.notes.append(f"not needed: {'; '.join(spare[:FEW])}{more}")
            cure.change = candidate_changes.of_parts(part for part in whole if part in needed)
            cure.trial = self.lab.measure(cure.change, "the parts that are needed")
        parts = []
        for part in candidate_changes.parts(cure.change):
            rest, why = candidate_changes.without(cure.change, part), f"without {in_words(part.plain)}"
            trial = self.lab.measure(rest, why)
            parts.append(Part(change=part, without=trial if trial.bad else None))
        cure.parts = tuple(parts)

    def _keeping(self, parts: tuple[Change, ...]) -> Answer:
        """Measure the cell with only some parts of the remedy, and return whether they cure."""
        trial = self.lab.measure(
            candidate_changes.of_parts(parts), f"with {format_count(len(parts), 'part')} of the remedy"
        )
        if trial.works and not self._no_cure(self.before, trial):
            return Answer.GOOD
        return Answer.BAD if trial.bad or trial.works else Answer.UNTESTABLE

    def _stands(self) -> None:
        """Run the unchanged cell once more. If it works then, it is flaky, and nothing was cured."""
        failed = self.before.failure
        if failed is None or failed.phase in {Phase.RESOLVE, Phase.INSTALL}:
            return
        again = self.lab.measure(Change(), "as it is asked for, once more", again=True)
        if again.works:
            self.flaky, self.cure = True, None
            self.notes.append("as it is asked for it failed, and then worked: it is flaky, and no fix can be shown")

    # --- the answer ------------------------------------------------------------------------------------------------

    def _answer(self, stopped: str | None) -> RepairResult:
        cure = self.cure
        waiting = [*([self.now] if self.now else []), *sorted(self.queue)]
        left = tuple(dict.fromkeys(str(entry.way) for entry in waiting)) if stopped and not cure else ()
        # A cure whose proof the budget cut off is still reported; `sufficient` says whether it was shown.
        if cure is None or (not cure.proven and not stopped):
            ends = [one.trial.assessed for one in self.lab.runs]
            unclear = [one for one in ends if one.verdict is Verdict.INCONCLUSIVE]
            if unclear:
                self.notes.append(f"{len(unclear)} of the runs are inconclusive: {unclear[0].decisive}")
            untold = unclear or self.flaky
            status = Status.STOPPED if stopped else Status.UNTOLD if untold else Status.NOT_FOUND
            notes = tuple(self.notes)
            return RepairResult(
                status=status, before=self.before, stopped=stopped, left=left, bound=self.bound, notes=notes
            )
        parts = cure.parts or tuple(Part(change=one, without=None) for one in candidate_changes.parts(cure.change))
        return RepairResult(
            status=Status.FOUND,
            before=self.before,
            change=cure.change,
            way=cure.move.way,
            why=cure.move.why,
            parts=parts,
            proof=cure.trial,
            moved=candidate_changes.find_replaced_packages(self.lab.base, cure.trial.cell),
            stopped=stopped,
            bound=self.bound,
            notes=tuple(self.notes),
        )

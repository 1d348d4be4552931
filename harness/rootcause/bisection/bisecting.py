"""Find by experiment where along a line of candidates a cell stops working (`bisect`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from harness.matrix import changes
from harness.model import Cell, Change, Phase, Question, Repair, Tried, cellid, replace
from harness.model.report_types import format_count, format_duration
from harness.model.vocabulary import required_name
from harness.rootcause.bench import Bench, BudgetExhausted, Trial
from harness.rootcause.bisection.behaviour import BehaviourPredicate, BehaviourTask
from harness.rootcause.bisection.candidates import Candidate
from harness.rootcause.bisection.good_end import GoodEndSearch, Look
from harness.rootcause.bisection.predicate import (
    Classification,
    Predicate,
    classify_working,
    has_package_failure,
    line_key,
    strip_run_count,
)
from harness.rootcause.search import Answer, Boundary, Refused, Rules, Search

AnyPredicate = Predicate | BehaviourPredicate

AHEAD = 2
"""Candidates that are prepared while one is tested."""

LOOKING = "looking for a good end"

HANDY = 0.4
"""What a test costs whose environment stands, beside one whose environment is still to be made."""


class Status(StrEnum):
    """The outcome of a bisection."""

    FOUND = "found"
    REFUSED = "refused"
    NO_GOOD_END = "no good end"
    STOPPED = "stopped short"
    UNTOLD = "could not tell"


@dataclass(frozen=True, kw_only=True, slots=True)
class Step:
    """One measured candidate. `why` is the reason to measure it.

    `why` is `bad end`, `good end`, `looking for a good end`, `half`, `at hand`, `again` or `whole`.
    """

    candidate: Candidate
    why: str
    trial: Trial
    classification: Classification


@dataclass(frozen=True, kw_only=True, slots=True)
class BisectionResult:
    """The result of a bisection. `good` and `bad` are the neighbours, measured in every phase.

    `line` runs from good to bad once both ends are known.
    """

    status: Status
    line: tuple[Candidate, ...]
    predicate: AnyPredicate | None = None
    boundary: Boundary[Candidate] | None = None
    good: Step | None = None
    bad: Step | None = None
    notes: tuple[str, ...] = ()
    oldest_first: bool = True


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The input of a bisection: the cell, its line (oldest first), the places of the ends, and the confidence wanted.

    `good` is None if a good end has to be found; `hints` are the places to try first. `base` is the unchanged cell, if
    it was measured. `behaves` is set if bad is another behaviour than that of the good end, which is given then.
    """

    cell: Cell
    axis: str
    line: tuple[Candidate, ...]
    bad: int
    good: int | None = None
    hints: tuple[int, ...] = ()
    any: bool = False
    confidence: float = 0.99
    recipes: Mapping[str, tuple[Repair, ...]] = field(default_factory=dict)
    base: Trial | None = None
    behaves: BehaviourTask | None = None


class Bisection:
    """One search on a bench; `steps` are all measurements in their order."""

    def __init__(self, task: Task, bench: Bench, say: Callable[[str], None]) -> None:
        self.task, self.bench, self.say = task, bench, say
        self.steps: list[Step] = []
        self.predicate: AnyPredicate | None = None
        self.notes: list[str] = []
        self._ends: GoodEndSearch | None = None

    def run(self) -> BisectionResult:
        """Find the boundary. Never raises Spent."""
        try:
            ended = self._ends_of_behaviour(self.task.behaves) if self.task.behaves else self._bad_end()
            if ended is not None:
                return self._answer(ended)
            good = self.task.good if self.task.good is not None else self._good_end()
        except BudgetExhausted as spent:
            self.notes += filter(None, (str(spent), self._tried()))
            return self._answer(Status.STOPPED)
        if good is None:
            return self._answer(self._without_good_end())
        return self._between(good)

    def _without_good_end(self) -> Status:
        """Return `NO_GOOD_END`, or `UNTOLD` if some candidates could not be judged here and may be good."""
        lost = [step.candidate.name for step in self.steps if step.trial.untold]
        if not lost:
            self.notes.append(f"no candidate was found that works: {self._tried()}")
            return Status.NO_GOOD_END
        self.notes.append(f"{', '.join(lost)} could not be measured here, and may work; {self._tried()}")
        return Status.UNTOLD

    # --- ends ------------------------------------------------------------------------------------------------------

    def _bad_end(self) -> Status | None:
        """Measure the bad end and look for its failure from now on. Return the status if the bisection ends here."""
        candidate = self.task.line[self.task.bad]
        base, same = self.task.base, candidate.change == Change()
        self.say(f"{self.task.axis} {candidate.name}, the bad end")
        whole = base if base and same else self.bench.measure(self.cell(candidate))
        # A flaky bad end may work at first; without repeats `bisect` got worlds of benchmarks/worlds.md wrong.
        for _ in range(round(-math.log10(1 - self.task.confidence))):
            if not whole.works:
                break
            self._note(candidate, "bad end", whole, classify_working(whole))  # it may be flaky
            whole = self.bench.measure(self.cell(candidate), again=True)
        self.predicate = Predicate(failure=None if self.task.any else strip_run_count(whole.failure))
        if whole.untold:
            classification = Classification(answer=Answer.UNTESTABLE, why=None, words=whole.failure_text)
            self._note(candidate, "bad end", whole, classification)
            return Status.UNTOLD
        if not has_package_failure(whole):
            self._note(candidate, "bad end", whole, classify_working(whole))
            self.notes.append(f"the bad end {candidate.name} is not bad: it {whole.success_text}")
            return Status.REFUSED
        self._note(candidate, "bad end", whole, self.predicate.classify(whole))
        self.bench.stop_after(self.predicate.until)
        return None

    def _ends_of_behaviour(self, behaves: BehaviourTask) -> Status | None:
        """Measure the good end, then the bad one against it. Return the status if the bisection ends here."""
        assert self.task.good is not None
        good, bad = self.task.line[self.task.good], self.task.line[self.task.bad]
        self.bench.stop_after(Phase.BEHAVE)
        self.say(f"{self.task.axis} {good.name}, the good end")
        trial = self.bench.measure(self.cell(good))
        self.predicate = behaves.compare_with(f"{self.task.axis} {good.name}", trial)
        if self.predicate is None:
            self.notes.append(f"the behaviour of the good end {good.name} could not be measured: {trial.failure_text}")
            return Status.UNTOLD
        self._note(good, "good end", trial, self.predicate.classify(trial))
        self.say(f"{self.task.axis} {bad.name}, the bad end")
        trial = self.bench.measure(self.cell(bad))
        classification = self.predicate.classify(trial)
        self._note(bad, "bad end", trial, classification)
        if classification.answer is Answer.BAD:
            return None
        self.notes.append(f"the bad end {bad.name}: {classification.words}")
        return Status.REFUSED if classification.answer is Answer.GOOD else Status.UNTOLD

    def _good_end(self) -> int | None:
        """Return the place of a good candidate, or None.

        Stored results come first, then the hints, then candidates further off, then those between two bad ones.
        """
        bad = self.task.bad
        last = next(step for step in reversed(self.steps) if step.candidate == self.task.line[bad])
        looks = {bad: _make_look(last.trial, last.classification)}
        for place, candidate in enumerate(self.task.line):
            trial = self.bench.at_hand(self.cell(candidate)) if place != bad else None
            if trial:
                looks[place] = _make_look(trial, self._predicate.classify(trial))

        def look(place: int) -> Look:
            classification = self._test(place, LOOKING, left=None)
            return _make_look(self.steps[-1].trial, classification)

        self._ends = GoodEndSearch(len(self.task.line), bad, looks, look)
        return self._ends.find(self.task.hints)

    def _beyond(self, good: int) -> Iterator[str]:
        """Yield a note if a candidate beyond the good end is not good either: then only a range of them works."""
        away = 1 if good > self.task.bad else -1
        looks = self._ends.looks if self._ends else {}
        behind = [
            place for place, look in looks.items() if (place - good) * away > 0 and look.answer is not Answer.GOOD
        ]
        if behind:
            name = self.task.line[min(behind, key=lambda place: abs(place - good))].name
            words = next(step.classification.words for step in reversed(self.steps) if step.candidate.name == name)
            yield f"only a range works: {self.task.axis} {name} fails as well ({words})"

    def _tried(self) -> str:
        """Return in words how many candidates were tried as a good end, and which ones were not."""
        if self._ends is None:
            return ""
        names = [one.name for one in self.task.line]
        left = [(names[low], names[high], high - low + 1) for low, high in self._ends.untried()]
        count = len(names) - sum(number for _, _, number in left)
        ranges = [low if number == 1 else f"{low} to {high} ({number})" for low, high, number in left]
        others = f"; not tried: {', '.join(ranges)}" if ranges else ""
        return f"{count} of {len(names)} candidates were tried{others}"

    # --- between ---------------------------------------------------------------------------------------------------

    def _between(self, good: int) -> BisectionResult:
        bad, line = self.task.bad, self.task.line
        line = line[good : bad + 1] if good <= bad else line[bad : good + 1][::-1]
        cells = [self.cell(one) for one in line]
        cost = [HANDY if self.bench.has_environment(cell) else 1.0 for cell in cells]
        search = Search(line, Rules(confidence=self.task.confidence), cost)
        self._seed(search, line, cells)
        status, lower, upper = Status.STOPPED, None, None
        try:
            # The status is set before the neighbours are measured: a budget that ends there does not undo the boundary.
            self._halve(search, line)
            status = self._status(search.result(), line)
            lower, upper = self._confirm_neighbours(search.result())
        except BudgetExhausted as spent:
            self.notes.append(str(spent))
        self.notes += self._beyond(good)
        return replace(
            self._answer(status), line=line, boundary=search.result(), good=lower, bad=upper, oldest_first=good <= bad
        )

    def _seed(self, search: Search[Candidate], line: Sequence[Candidate], cells: Sequence[Cell]) -> None:
        """Give the search all results measured before, and the stored results that cost nothing."""
        measured: dict[str, list[Classification]] = {}
        for step in self.steps:
            measured.setdefault(step.candidate.name, []).append(step.classification)
        for place, (candidate, cell) in enumerate(zip(line, cells, strict=True)):
            for classification in measured.get(candidate.name, ()):
                search.note(place, classification.answer, classification.why)
            # The result of a measured candidate is in the store by now; it must not count twice.
            trial = None if candidate.name in measured else self.bench.at_hand(cell)
            if trial:
                classification = self._predicate.classify(trial)
                self._note(candidate, "at hand", trial, classification)
                search.note(place, classification.answer, classification.why, free=True)

    def _halve(self, search: Search[Candidate], line: Sequence[Candidate]) -> None:
        while (place := search.next()) is not None:
            self.bench.prepare(self.cell(line[each]) for each in search.upcoming()[:AHEAD])
            classification = self._test(self.task.line.index(line[place]), "half", left=search.left)
            search.note(place, classification.answer, classification.why)

    def _test(self, place: int, why: str, *, left: int | None) -> Classification:
        """Measure a candidate, again if it was measured before, and return its answer."""
        candidate = self.task.line[place]
        before = [step for step in self.steps if step.candidate == candidate]
        steps = "" if left is None else f", about {format_count(left, 'step')} left{self._to_go(left)}"
        self.say(f"{'again ' if before else ''}{self.task.axis} {candidate.name}{steps}")
        trial = self.bench.measure(self.cell(candidate), again=bool(before))
        classification = self._predicate.classify(trial)
        self._note(candidate, "again" if before else why, trial, classification)
        return classification

    def _to_go(self, left: int) -> str:
        """Return the time that some more measurements take, by those of this search."""
        each = self.bench.mean_seconds
        return "" if each is None else f" (about {format_duration(left * each)})"

    def _confirm_neighbours(self, boundary: Boundary[Candidate]) -> tuple[Step | None, Step | None]:
        """Measure both neighbours in all phases and return them; (None, None) if there is no boundary."""
        steps = []
        for candidate in (boundary.good, boundary.bad):
            if candidate is None:
                return None, None
            self.say(f"{self.task.axis} {candidate.name} in all phases")
            # A cell that was only stepped from states must not replace its whole record.
            trial = self.bench.measure(self.cell(candidate), keep=not self.task.behaves, whole=True)
            steps.append(self._note(candidate, "whole", trial, self._predicate.classify(trial)))
        return steps[0], steps[1]

    def _status(self, boundary: Boundary[Candidate], line: Sequence[Candidate]) -> Status:
        if boundary.refused is None:
            return Status.FOUND
        end = line[0] if boundary.refused in {Refused.GOOD_IS_BAD, Refused.GOOD_UNTESTABLE} else line[-1]
        step = next(step for step in reversed(self.steps) if step.candidate == end)
        self.notes.append(f"{boundary.refused}: {end.name}: {step.classification.words}")
        return Status.UNTOLD if step.trial.untold else Status.REFUSED

    # --- parts -----------------------------------------------------------------------------------------------------

    @property
    def _predicate(self) -> AnyPredicate:
        assert self.predicate is not None
        return self.predicate

    def cell(self, candidate: Candidate) -> Cell:
        """Return the cell with the change of a candidate; the base cell itself if that changes nothing."""
        base = self.task.cell
        changed_cell = changes.apply(base, candidate.change, self.task.recipes)
        if changes.same(changed_cell, base):
            return base
        changed_cell = replace(changed_cell, question=_in_place(changed_cell.question, base.question))
        axis = {"--python": "py", "--date": "date-"}.get(self.task.axis, f"{self.task.axis}-")
        name = cellid.spell(f"{axis}{candidate.name}")
        reason = f"a bisection along {self.task.axis}"
        tried = Tried(name=name, reason=reason, change=candidate.change, proving=True)
        return replace(
            changed_cell, id=changes.id_of(base, name, candidate.change), base=base.id, tried=tried, expect=None
        )

    def _note(self, candidate: Candidate, why: str, trial: Trial, classification: Classification) -> Step:
        until = self.predicate.until if self.predicate else Phase.SUITE
        if trial.works and why != "whole" and until is not Phase.SUITE and not self.task.behaves:
            classification = replace(classification, words=f"passes {until}")  # nothing behind it was run
        step = Step(candidate=candidate, why=why, trial=trial, classification=classification)
        self.steps.append(step)
        self.say(
            f"  {classification.answer}: {classification.words}"
            + (" (measured before)" if trial.at_hand else f" ({trial.seconds:.0f} s)")
        )
        return step

    def _answer(self, status: Status) -> BisectionResult:
        return BisectionResult(status=status, line=self.task.line, predicate=self.predicate, notes=tuple(self.notes))


def _in_place(question: Question, before: Question) -> Question:
    """Return the question with its lines in the order of the old one, as another cell may have asked just this."""
    old = [required_name(line) for line in before.requirements]
    order = {name: place for place, name in reversed(list(enumerate(old)))}
    lines = sorted(question.requirements, key=lambda line: order.get(required_name(line), len(old)))
    return replace(question, requirements=tuple(lines))


def _make_look(trial: Trial, classification: Classification) -> Look:
    failed = strip_run_count(trial.failure)
    return Look(answer=classification.answer, failure=line_key(failed) if failed else trial.assessed.verdict)

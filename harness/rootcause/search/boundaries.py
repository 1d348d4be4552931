"""Find the last good and the first bad candidate of a line (`boundary`), and every other change along it."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, TypeVar

from harness.rootcause.search.answers import USUAL, Answer, Observation, Refused, Rules
from harness.rootcause.search.line import Line

T = TypeVar("T")

FLIPPED = {Answer.GOOD: Answer.BAD, Answer.BAD: Answer.GOOD}


@dataclass(frozen=True, kw_only=True, slots=True)
class Turn(Generic[T]):
    """A change along the line: the result `was` of `before`, and the result `becomes` of `after`.

    `between` are the candidates between them that were not tested.
    """

    before: T
    after: T
    was: Hashable
    becomes: Hashable
    between: tuple[T, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Boundary(Generic[T]):
    """The neighbours `good` and `bad`, with those `between` them that could not be tested or were not tried.

    Both are None if an end is `refused`. `observations` is every answer in order. `bound` is how many answers a
    search without flakiness needs at most, both ends included. `chain` is every change that was seen along the line.
    """

    good: T | None
    bad: T | None
    between: tuple[T, ...]
    confidence: float
    observations: tuple[Observation[T], ...]
    refused: Refused | None
    bound: int
    rates: tuple[float, float]
    chain: tuple[Turn[T], ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Progress(Generic[T]):
    """The candidate that is tested now, those that may come next, and about how many answers are left."""

    candidate: T
    upcoming: tuple[T, ...]
    left: int


def bound(count: int) -> int:
    """Return how many answers a binary search of so many candidates needs at most, both ends confirmed."""
    return min(count, 2) + (math.ceil(math.log2(count - 1)) if count > 2 else 0)


@dataclass
class Stretch:
    """A part of the line with one boundary; a `flipped` one turns from bad to good."""

    low: int
    line: Line
    flipped: bool

    def note(self, index: int, answer: Answer, why: Hashable) -> None:
        """Take an answer about a candidate of the whole line, if the candidate lies here."""
        if self.low <= index < self.low + self.line.length:
            self.line.note(index - self.low, FLIPPED.get(answer, answer) if self.flipped else answer, why)


@dataclass
class Search(Generic[T]):
    """A search that is driven from outside: `next` names the candidate to test, `note` takes its answer.

    If the answers contradict a single boundary, the line is split. The last stretch is searched first, then the others.
    """

    candidates: Sequence[T]
    rules: Rules = USUAL
    cost: Sequence[float] = ()
    observations: list[Observation[T]] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._answers: list[tuple[int, Answer, Hashable]] = []
        self._stretches = [self._stretch(0, len(self.candidates) - 1, flipped=False)]

    def note(self, index: int, answer: Answer, why: Hashable = None, *, free: bool = False) -> None:
        """Take an answer. `why` is the failure of an untestable candidate, `free` is true if nothing was run for it."""
        self._answers.append((index, answer, why))
        self.observations.append(Observation(candidate=self.candidates[index], answer=answer, free=free))
        for stretch in self._stretches:
            stretch.note(index, answer, why)
        self._split()

    def next(self) -> int | None:
        """Return the index of the candidate to test next; None if all boundaries stand, or no test can tell more."""
        for stretch in self._stretches:
            index = stretch.line.next()
            if index is not None:
                return stretch.low + index
        return None

    def upcoming(self) -> tuple[int, ...]:
        """Return the indices to test after the next one, for a good and for a bad answer, the likelier first."""
        for stretch in self._stretches:
            if stretch.line.next() is not None:
                return tuple(stretch.low + index for index in stretch.line.upcoming())
        return ()

    @property
    def left(self) -> int:
        """Return about how many answers are still needed."""
        return sum(stretch.line.left for stretch in self._stretches)

    def result(self) -> Boundary[T]:
        """Return the boundary as far as it is known."""
        main = self._stretches[0]
        gap, refused = main.line.gap, main.line.refused
        there = refused is None and gap.good >= 0 and gap.bad < main.line.length
        low, high = main.low + gap.good, main.low + gap.bad
        return Boundary(
            good=self.candidates[low] if there else None,
            bad=self.candidates[high] if there else None,
            between=tuple(self.candidates[low + 1 : high]) if there else (),
            confidence=gap.mass,
            observations=tuple(self.observations),
            refused=refused,
            bound=bound(len(self.candidates)),
            rates=main.line.places.rates,
            chain=self._chain(),
        )

    def _stretch(self, low: int, high: int, *, flipped: bool) -> Stretch:
        cost = self.cost[low : high + 1]
        return Stretch(low=low, line=Line(high - low + 1, self.rules, cost), flipped=flipped)

    def _split(self) -> None:
        """Split a stretch in which a bad candidate stands before a good one. The last part is searched first."""
        for place, stretch in enumerate(self._stretches):
            split_pair = stretch.line.split
            if split_pair is None:
                continue
            ends = [0, *split_pair, stretch.line.length - 1]
            flips = [stretch.flipped, not stretch.flipped, stretch.flipped]
            parts = [
                self._stretch(stretch.low + low, stretch.low + high, flipped=flipped)
                for low, high, flipped in zip(ends[:-1], ends[1:], flips, strict=True)
            ]
            for part in parts:
                for answer in self._answers:
                    part.note(*answer)
            self._stretches[place : place + 1] = reversed(parts)
            return

    def _chain(self) -> tuple[Turn[T], ...]:
        """Return each change between two tested candidates, in the order of the line."""
        answers: dict[int, list[Hashable]] = {}
        for index, answer, why in self._answers:
            # An untestable candidate without a `why` says nothing about its place, so it is no link of the chain.
            if answer is not Answer.UNTESTABLE or why is not None:
                answers.setdefault(index, []).append(why if answer is Answer.UNTESTABLE else answer)
        kinds = {index: self._kind(index, answers[index]) for index in sorted(answers)}
        places = list(kinds)
        return tuple(
            Turn(
                before=self.candidates[low],
                after=self.candidates[high],
                was=kinds[low],
                becomes=kinds[high],
                between=tuple(self.candidates[low + 1 : high]),
            )
            for low, high in pairwise(places)
            if kinds[low] != kinds[high]
        )

    def _kind(self, index: int, answers: Sequence[Hashable]) -> Hashable:
        """Return whether a candidate is taken to be good or bad after all its answers, else its failure."""
        if not {Answer.GOOD, Answer.BAD, Answer.FLAKY} & set(answers):
            return answers[-1]
        for stretch in self._stretches:
            if stretch.low <= index < stretch.low + stretch.line.length:
                bad = stretch.line.places.bad(index - stretch.low) > 0.5
                return Answer.BAD if bad != stretch.flipped else Answer.GOOD
        raise AssertionError


def boundary(
    candidates: Sequence[T],
    test: Callable[[T], Answer],
    *,
    rules: Rules = USUAL,
    prior_answers: Mapping[int, Sequence[Answer]] | None = None,
    watch: Callable[[Progress[T]], None] | None = None,
) -> Boundary[T]:
    """Find where candidates turn from good to bad. The first is assumed to be good, the last to be bad.

    `prior_answers` maps places of candidates to answers at hand. Exceptions of `test` pass through.
    """
    search = Search(candidates, rules)
    for place, answers in (prior_answers or {}).items():
        for answer in answers:
            search.note(place, answer, free=True)
    while (index := search.next()) is not None:
        if watch:
            after = tuple(candidates[each] for each in search.upcoming())
            watch(Progress(candidate=candidates[index], upcoming=after, left=search.left))
        search.note(index, test(candidates[index]))
    return search.result()

"""Find a smallest set among many changes that together cure (`minimise`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from harness.rootcause.search.answers import USUAL, Answer, Observation, Rules
from harness.rootcause.search.boundaries import bound, boundary

T = TypeVar("T")

MOST = 9
"""Answers of one set, however they differ."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Minimal(Generic[T]):
    """The `items` that cure, none of which can be left out as far as that could be tested; None if all do not cure.

    `observations` is every test in order, `bound` how many tests a single culprit needs at most. Leaving out an item of
    `unsure` could not be tested.
    """

    items: tuple[T, ...] | None
    observations: tuple[Observation[tuple[T, ...]], ...]
    bound: int
    unsure: tuple[T, ...] = ()


def minimise(items: Sequence[T], test: Callable[[tuple[T, ...]], Answer], *, rules: Rules = USUAL) -> Minimal[T]:
    """Return a set of items that cures and from which no item can be left out.

    `test` says whether a set, in the order of `items`, is good. The whole set is assumed to be good, the empty one bad.
    One culprit takes about as many tests as a binary search. Exceptions of `test` pass through.
    """
    return _Search(items, test, rules).run()


class _Search(Generic[T]):
    """The state of one search: the answers of each tested set."""

    def __init__(self, items: Sequence[T], test: Callable[[tuple[T, ...]], Answer], rules: Rules) -> None:
        self.items = tuple(items)
        self.test = test
        self.rules = rules
        self.observations: list[Observation[tuple[T, ...]]] = []
        self.answers: dict[frozenset[int], list[Answer]] = {}

    def run(self) -> Minimal[T]:
        needed: frozenset[int] = frozenset()
        rest = len(self.items)
        while True:
            span = self._shortest(needed, rest)
            if span is None:
                break
            low, high = span
            needed |= frozenset(range(low, high))
            # With `needed`, `range(high)` cures and `range(low)` does not, so what is still missing lies below `low`.
            rest = low
            if not rest or self._good(needed):
                return self._make_result(*self._spared(needed))
        if not needed:
            return self._make_result(None, ())
        return self._make_result(*self._spared(needed | frozenset(range(rest))))

    def _make_result(self, indices: frozenset[int] | None, unsure: Sequence[int]) -> Minimal[T]:
        return Minimal(
            items=None if indices is None else self._set(indices),
            observations=tuple(self.observations),
            bound=bound(len(self.items) + 1),
            unsure=tuple(self.items[index] for index in unsure),
        )

    def _set(self, indices: frozenset[int]) -> tuple[T, ...]:
        return tuple(self.items[index] for index in sorted(indices))

    def _ask(self, indices: frozenset[int]) -> Answer:
        chosen = self._set(indices)
        answer = self.test(chosen)
        self.observations.append(Observation(candidate=chosen, answer=answer))
        self.answers.setdefault(indices, []).append(answer)
        return answer

    def _shortest(self, needed: frozenset[int], rest: int) -> tuple[int, int] | None:
        """Return the items with which growing prefixes start to cure, as (first, after last).

        The needed items are added to each prefix. None if all items together do not cure.
        """
        sets = [needed | frozenset(range(count)) for count in range(rest, -1, -1)]
        answers = {place: self.answers[each] for place, each in enumerate(sets) if each in self.answers}
        edge = boundary(sets, self._ask, rules=self.rules, prior_answers=answers)
        if edge.good is None or edge.bad is None:
            return None
        return len(sets) - 1 - sets.index(edge.bad), len(sets) - 1 - sets.index(edge.good)

    def _good(self, indices: frozenset[int]) -> bool:
        """Return whether a set cures. It is tested until one side leads by as much as the confidence requires."""
        wanted = max(1, round(-math.log10(max(1 - self.rules.confidence, 1e-9))))
        while True:
            answers = self.answers.get(indices, [])
            lead = answers.count(Answer.GOOD) - answers.count(Answer.BAD) - answers.count(Answer.FLAKY)
            if abs(lead) >= wanted or len(answers) >= MOST or Answer.UNTESTABLE in answers:
                return lead > 0
            self._ask(indices)

    def _spared(self, needed: frozenset[int]) -> tuple[frozenset[int], tuple[int, ...]]:
        """Return the set without the items that are not needed, and those items for which that is unknown."""
        unsure = []
        for index in sorted(needed):
            without = needed - {index}
            if not without:
                continue
            if Answer.UNTESTABLE in self.answers.get(without, ()):
                unsure.append(index)
            elif self._good(without):
                needed = without
            elif self.answers[without][-1] is Answer.UNTESTABLE:
                unsure.append(index)
        return needed, tuple(index for index in unsure if index in needed)

"""Search a line for one boundary: choose the candidate to test next, and decide when the boundary stands."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property

from harness.rootcause.search.answers import Answer, Refused, Rules
from harness.rootcause.search.posterior import Posterior, compute_posterior

CHEAP = 0.25
"""How much of what it tells may be given up for an answer that costs nothing."""

FLAKIEST = 0.2
"""The rate of wrong answers beside which answers that contradict a single boundary are believed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Gap:
    """A place for the boundary, between two testable candidates. -1 and the length of the line are beyond the ends.

    `mass` is the probability of the place.
    """

    good: int
    bad: int
    mass: float


class Line:
    """Candidates 0, 1, ... with their answers. The first is assumed to be good, the last to be bad."""

    def __init__(self, length: int, rules: Rules, cost: Sequence[float] = ()) -> None:
        self.length = length
        self.rules = rules
        self.cost = cost or [1.0] * length
        self.good, self.bad = [0] * length, [0] * length
        self.untestable: dict[int, Hashable] = {}
        self.given_up: set[int] = set()

    def note(self, index: int, answer: Answer, why: Hashable = None) -> None:
        """Take an answer. `why` is the failure of an untestable candidate.

        Candidates between two untestable ones with the same failure are assumed to share it.
        """
        if answer is Answer.UNTESTABLE:
            if not self.good[index] and not self.bad[index]:
                self.untestable[index] = why
                self._fill(index, why)
        else:
            self.good[index] += answer is not Answer.BAD
            self.bad[index] += answer is not Answer.GOOD
            self.untestable.pop(index, None)
        # `cached_property` keeps its value in `__dict__`; once it is removed there, the next use computes it anew.
        for cached_name in ("places", "contradiction", "gaps"):
            self.__dict__.pop(cached_name, None)
        self._give_up()

    def next(self) -> int | None:
        """Return the candidate to test next; None if the boundary stands, or no test can tell more."""
        forced = self._end() if self.refused is None else None
        if forced is not None or self.refused is not None:
            return forced
        if self.stands:
            return None
        suspects = self.contradiction
        if suspects is not None:
            return self._suspect(suspects)
        gains = self.places.gains()
        open_ = [index for index in range(self.length) if self._is_tested(index) or self._open(index)]
        scores = {index: gains[index] * self._testable(index) * self._cheap(index) for index in open_}
        return max(scores, key=lambda index: (scores[index], -index)) if scores else None

    def upcoming(self) -> tuple[int, ...]:
        """Return the candidates to test after the next one, for a good and for a bad answer, the likelier first."""
        following = self.next()
        if following is None:
            return ()
        candidates = []
        for answer in (Answer.GOOD, Answer.BAD):
            other = deepcopy(self)
            other.note(following, answer)
            candidates.append(other.next())
        if self.places.bad(following) > 0.5:
            candidates.reverse()
        return tuple(dict.fromkeys(index for index in candidates if index is not None and index != following))

    @property
    def left(self) -> int:
        """Return about how many answers are still needed."""
        ends = sum(not self._is_tested(index) for index in {0, self.length - 1})
        if self.refused or (not ends and self.stands):
            return 0
        masses = [gap.mass for gap in self.gaps if gap.mass > 0]
        return ends + max(1, math.ceil(-sum(mass * math.log2(mass) for mass in masses) - 0.2))

    @cached_property
    def places(self) -> Posterior:
        """Return the probability of each place of the boundary."""
        return compute_posterior(self.good, self.bad)

    @property
    def gap(self) -> Gap:
        """Return the likeliest place of the boundary."""
        return max(self.gaps, key=lambda gap: gap.mass)

    @property
    def stands(self) -> bool:
        """Return whether the likeliest place is as likely as required, and both its sides were tested."""
        gap = self.gap
        sides = gap.good < 0 or self.good[gap.good] > 0, gap.bad >= self.length or self.bad[gap.bad] > 0
        return all(sides) and gap.mass >= self.rules.confidence and self.contradiction is None

    @property
    def refused(self) -> Refused | None:
        """Return which end is not as claimed; None if there is no such end."""
        if 0 in self.untestable:
            return Refused.GOOD_UNTESTABLE
        if self.length - 1 in self.untestable:
            return Refused.BAD_UNTESTABLE
        if self._end() is not None or not self.stands:
            return None
        gap = self.gap
        if gap.good < 0:
            return Refused.GOOD_IS_BAD
        return Refused.BAD_IS_GOOD if gap.bad >= self.length else None

    @property
    def split(self) -> tuple[int, int] | None:
        """Return a bad candidate and a later good one that both stand, as there are several boundaries; else None."""
        suspects = self.contradiction
        return suspects if suspects and all(self._count(each) >= self._enough for each in suspects) else None

    # --- parts -----------------------------------------------------------------------------------------------------

    def _end(self) -> int | None:
        """Return an end that was not tested yet; None if both were."""
        ends = (self.length - 1, 0)
        return next((index for index in ends if not self._is_tested(index) and index not in self.untestable), None)

    def _count(self, index: int) -> int:
        return self.good[index] + self.bad[index]

    def _is_tested(self, index: int) -> bool:
        return self._count(index) > 0

    def _open(self, index: int) -> bool:
        return index not in self.untestable and index not in self.given_up

    @cached_property
    def gaps(self) -> list[Gap]:
        """Return the places between testable candidates, with their probabilities."""
        stops = [index for index in range(self.length) if self._is_tested(index) or self._open(index)]
        pairs = zip([-1, *stops], [*stops, self.length], strict=True)
        return [Gap(good=low, bad=high, mass=self.places.within(low + 1, high)) for low, high in pairs]

    def _testable(self, index: int) -> float:
        """Return the chance that a candidate can be tested. It is lower near one that could not."""
        if self._is_tested(index):
            return 1.0
        return min((1 - 0.5 / abs(index - each) for each in self.untestable), default=1.0)

    def _cheap(self, index: int) -> float:
        return 1 + CHEAP * (1 - min(self.cost[index], 1.0))

    @property
    def _enough(self) -> int:
        """Return how many equal answers each side needs to disprove a single boundary."""
        return 1 + math.ceil(math.log(max(1 - self.rules.confidence, 1e-9)) / math.log(FLAKIEST))

    @cached_property
    def contradiction(self) -> tuple[int, int] | None:
        """Return the most surprising pair of a bad and a later good candidate, or None.

        Neither of the two ever gave another answer.
        """
        pairs: list[tuple[int, int]] = []
        last: int | None = None
        for index in range(self.length):
            if self.bad[index] and not self.good[index]:
                last = index
            elif self.good[index] and not self.bad[index] and last is not None:
                pairs.append((last, index))
        return max(pairs, key=lambda pair: (self._surprise(pair), -pair[1])) if pairs else None

    def _surprise(self, pair: tuple[int, int]) -> float:
        return max(1 - self.places.bad(pair[0]), self.places.bad(pair[1]))

    def _suspect(self, pair: tuple[int, int]) -> int | None:
        """Return which of two contradictory candidates to test again; None if both stand."""
        if self.split:
            return None
        first, second = pair
        if self._count(first) != self._count(second):
            return min(pair, key=self._count)
        return first if 1 - self.places.bad(first) > self.places.bad(second) else second

    def _fill(self, index: int, why: Hashable) -> None:
        """Give up the untested candidates between two with the same failure: they are assumed to share it."""
        for other, cause in self.untestable.items():
            low, high = sorted((index, other))
            if why is not None and cause == why and not any(map(self._is_tested, range(low, high))):
                self.given_up |= {each for each in range(low, high) if self._open(each)}
                self.__dict__.pop("gaps", None)

    def _give_up(self) -> None:
        """Give up the candidates between untestable ones if too many of these lie around the boundary."""
        gap = self.gap
        low = max((each for each in range(max(gap.good, 0) + 1) if self._is_tested(each)), default=0)
        high = min((each for each in range(gap.bad, self.length) if self._is_tested(each)), default=self.length - 1)
        inside = [each for each in self.untestable if low < each < high]
        if len(inside) >= self.rules.patience:
            self.given_up |= {each for each in range(min(inside), max(inside)) if self._open(each)}
            self.__dict__.pop("gaps", None)

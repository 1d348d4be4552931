"""The search for one boundary along a line: which candidate to ask next, and when the boundary stands."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property

from harness.rootcause.search.answers import Answer, Refused, Rules
from harness.rootcause.search.posterior import Posterior, weighed

CHEAP = 0.25
"""How much of what it tells may be given up for an answer that costs nothing."""

FLAKIEST = 0.2
"""The rate of wrong answers beside which answers that contradict a single boundary are believed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Gap:
    """A place for the boundary: between two candidates that can be tested, -1 and the length being beyond the ends."""

    good: int
    bad: int
    mass: float


class Line:
    """Candidates 0, 1, ... of which the first is said to be good and the last to be bad, and what they answered."""

    def __init__(self, length: int, rules: Rules, cost: Sequence[float] = ()) -> None:
        self.length = length
        self.rules = rules
        self.cost = cost or [1.0] * length
        self.good, self.bad = [0] * length, [0] * length
        self.untestable: dict[int, Hashable] = {}
        self.given_up: set[int] = set()

    def note(self, index: int, answer: Answer, why: Hashable = None) -> None:
        """Take an answer; `why` is what an untestable one failed of, between two of which others are taken to lie."""
        if answer is Answer.UNTESTABLE:
            if not self.good[index] and not self.bad[index]:
                self.untestable[index] = why
                self._fill(index, why)
        else:
            self.good[index] += answer is not Answer.BAD
            self.bad[index] += {Answer.GOOD: 0, Answer.FLAKY: 1}.get(answer, self.rules.looks)
            self.untestable.pop(index, None)
        for kept in ("places", "contradiction", "gaps"):
            self.__dict__.pop(kept, None)
        self._give_up()

    def next(self) -> int | None:
        """The candidate to ask next; None where the boundary stands, or nothing more can be told."""
        forced = self._end() if self.refused is None else None
        if forced is not None or self.refused is not None:
            return forced
        if self.stands:
            return None
        suspects = self.contradiction
        if suspects is not None:
            return self._suspect(suspects)
        gains = self.places.gains()
        open_ = [index for index in range(self.length) if self._asked(index) or self._open(index)]
        scores = {index: gains[index] * self._testable(index) * self._cheap(index) for index in open_}
        return max(scores, key=lambda index: (scores[index], -index)) if scores else None

    def upcoming(self) -> tuple[int, ...]:
        """What is asked after the next one, be that good or bad; the likelier first."""
        following = self.next()
        if following is None:
            return ()
        found = []
        for answer in (Answer.GOOD, Answer.BAD):
            other = deepcopy(self)
            other.note(following, answer)
            found.append(other.next())
        if self.places.bad(following) > 0.5:
            found.reverse()
        return tuple(dict.fromkeys(index for index in found if index is not None and index != following))

    @property
    def left(self) -> int:
        """About how many answers are still wanted."""
        ends = sum(not self._asked(index) for index in {0, self.length - 1})
        if self.refused or (not ends and self.stands):
            return 0
        masses = [gap.mass for gap in self.gaps if gap.mass > 0]
        return ends + max(1, math.ceil(-sum(mass * math.log2(mass) for mass in masses) - 0.2))

    @cached_property
    def places(self) -> Posterior:
        """Where the boundary may be."""
        return weighed(self.good, self.bad)

    @property
    def gap(self) -> Gap:
        """The likeliest place."""
        return max(self.gaps, key=lambda gap: gap.mass)

    @property
    def stands(self) -> bool:
        """Return whether the likeliest place is as likely as asked for, and both its sides were seen."""
        gap = self.gap
        sides = gap.good < 0 or self.good[gap.good] > 0, gap.bad >= self.length or self.bad[gap.bad] > 0
        return all(sides) and gap.mass >= self.rules.confidence and self.contradiction is None

    @property
    def refused(self) -> Refused | None:
        """The end that is not what it was said to be."""
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
        """A bad candidate before a good one, both of which stand: there are several boundaries."""
        suspects = self.contradiction
        return suspects if suspects and all(self._count(each) >= self._enough for each in suspects) else None

    # --- parts -----------------------------------------------------------------------------------------------------

    def _end(self) -> int | None:
        """An end that nobody has looked at."""
        ends = (self.length - 1, 0)
        return next((index for index in ends if not self._asked(index) and index not in self.untestable), None)

    def _count(self, index: int) -> int:
        return self.good[index] + self.bad[index]

    def _asked(self, index: int) -> bool:
        return self._count(index) > 0

    def _open(self, index: int) -> bool:
        return index not in self.untestable and index not in self.given_up

    @cached_property
    def gaps(self) -> list[Gap]:
        """The places between candidates that can be tested, with how likely each is."""
        stops = [index for index in range(self.length) if self._asked(index) or self._open(index)]
        pairs = zip([-1, *stops], [*stops, self.length], strict=True)
        return [Gap(good=low, bad=high, mass=self.places.within(low + 1, high)) for low, high in pairs]

    def _testable(self, index: int) -> float:
        """How likely a candidate can be tested: less so beside one that could not."""
        if self._asked(index):
            return 1.0
        return min((1 - 0.5 / abs(index - each) for each in self.untestable), default=1.0)

    def _cheap(self, index: int) -> float:
        return 1 + CHEAP * (1 - min(self.cost[index], 1.0))

    @property
    def _enough(self) -> int:
        """Return how many like answers stand against a single boundary."""
        return 1 + math.ceil(math.log(max(1 - self.rules.confidence, 1e-9)) / math.log(FLAKIEST))

    @cached_property
    def contradiction(self) -> tuple[int, int] | None:
        """The nearest two, bad before good, neither of which ever answered otherwise."""
        found: list[tuple[int, int]] = []
        last: int | None = None
        for index in range(self.length):
            if self.bad[index] and not self.good[index]:
                last = index
            elif self.good[index] and not self.bad[index] and last is not None:
                found.append((last, index))
        return max(found, key=lambda pair: (self._surprise(pair), -pair[1])) if found else None

    def _surprise(self, pair: tuple[int, int]) -> float:
        return max(1 - self.places.bad(pair[0]), self.places.bad(pair[1]))

    def _suspect(self, pair: tuple[int, int]) -> int | None:
        """Which of two that contradict each other is asked again; None where both stand."""
        if self.split:
            return None
        first, second = pair
        if self._count(first) != self._count(second):
            return min(pair, key=self._count)
        return first if 1 - self.places.bad(first) > self.places.bad(second) else second

    def _fill(self, index: int, why: Hashable) -> None:
        """What lies between two that failed of the same, and of which nothing is known, is taken to do so."""
        for other, cause in self.untestable.items():
            low, high = sorted((index, other))
            if why is not None and cause == why and not any(map(self._asked, range(low, high))):
                self.given_up |= {each for each in range(low, high) if self._open(each)}
                self.__dict__.pop("gaps", None)

    def _give_up(self) -> None:
        """Where too many on the way could not be tested, what lies between these is not tried."""
        gap = self.gap
        low = max((each for each in range(max(gap.good, 0) + 1) if self._asked(each)), default=0)
        high = min((each for each in range(gap.bad, self.length) if self._asked(each)), default=self.length - 1)
        inside = [each for each in self.untestable if low < each < high]
        if len(inside) >= self.rules.patience:
            self.given_up |= {each for each in range(min(inside), max(inside)) if self._open(each)}
            self.__dict__.pop("gaps", None)

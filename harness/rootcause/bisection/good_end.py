"""Find a candidate that works if only a failing one is known. Pure: a callable tests the candidates.

Good guesses come first, then candidates ever further off on both sides, then those between two that fail.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

from harness.rootcause.search import Answer

WINDOWS = 16
"""Candidates between two bad ones that are tried at most; a range of good ones may be as short as one release."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """The result of one candidate. `failure` is equal for two candidates that fail in the same way."""

    answer: Answer
    failure: Hashable = None


class GoodEndSearch:
    """One search along `count` candidates. `looks` maps places to results, the place `bad` included."""

    def __init__(self, count: int, bad: int, looks: Mapping[int, Look], look: Callable[[int], Look]) -> None:
        self.count, self.bad, self.looks, self._look = count, bad, dict(looks), look

    def find(self, guesses: Iterable[int]) -> int | None:
        """Return the place of a good candidate; None if none was found. Exceptions of a look pass through."""
        good = [place for place, look in self.looks.items() if look.answer is Answer.GOOD]
        if good:
            return min(good, key=lambda place: abs(place - self.bad))
        for place in guesses:
            if self._answer(place) is Answer.GOOD:
                return place
        ends = [end for end in (0, self.count - 1) if end != self.bad]
        good_place = next((good_place for end in ends if (good_place := self._towards(end)) is not None), None)
        return self._between() if good_place is None else good_place

    def untried(self) -> Iterator[tuple[int, int]]:
        """Yield the first and the last place of each range that was not tested."""
        for low, high in pairwise((-1, *sorted(self.looks), self.count)):
            if high - low > 1:
                yield low + 1, high - 1

    def _answer(self, place: int) -> Answer:
        if place not in self.looks:
            self.looks[place] = self._look(place)
        return self.looks[place].answer

    def _towards(self, end: int) -> int | None:
        """Test at doubling distances on one side of the bad candidate, then before untestable ones."""
        last = abs(end - self.bad)
        sign = 1 if end > self.bad else -1
        near: int = 0
        far: int | None = None
        for off in dict.fromkeys([*(1 << power for power in range(last.bit_length()) if 1 << power < last), last]):
            answer = self._answer(self.bad + sign * off)
            if answer is Answer.GOOD:
                return self.bad + sign * off
            near, far = (near, far or off) if answer is Answer.UNTESTABLE else (off, None)
        # A short range of good candidates may lie just before those that cannot be tested; doubling steps over it.
        while far is not None and far - near > 1:
            off = (near + far) // 2
            answer = self._answer(self.bad + sign * off)
            if answer is Answer.GOOD:
                return self.bad + sign * off
            near, far = (near, off) if answer is Answer.UNTESTABLE else (off, far)
        return None

    def _between(self) -> int | None:
        """Halve gaps between two candidates that fail: first where they fail differently, then the widest.

        Where all older candidates fail in one way and all newer ones in another, this finds what works between them.
        """
        for _ in range(WINDOWS):
            gaps = [(low, high) for low, high in pairwise(sorted(self.looks)) if high - low > 1]
            if not gaps:
                return None
            low, high = max(gaps, key=self._promise)
            if self._answer((low + high) // 2) is Answer.GOOD:
                return (low + high) // 2
        return None

    def _promise(self, gap: tuple[int, int]) -> tuple[bool, int]:
        low, high = gap
        return self.looks[low].failure != self.looks[high].failure, high - low

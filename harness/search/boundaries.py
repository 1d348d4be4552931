"""`boundary`: the last good and the first bad of a line of candidates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from harness.search.answers import USUAL, Answer, Asked, Refused, Rules
from harness.search.line import Line

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, slots=True)
class Boundary(Generic[T]):
    """The neighbours `good` and `bad`, with those `between` them that could not be tested or were not tried.

    Neither is there where an end is `refused`. `asked` is every answer in its order, `bound` how many a search without
    flakiness needs at most, both ends among them.
    """

    good: T | None
    bad: T | None
    between: tuple[T, ...]
    confidence: float
    asked: tuple[Asked[T], ...]
    refused: Refused | None
    bound: int

    @property
    def found(self) -> bool:
        """Whether there is a boundary."""
        return self.good is not None


@dataclass(frozen=True, kw_only=True, slots=True)
class Progress(Generic[T]):
    """What is asked now, what may come after it, and about how many answers are left."""

    candidate: T
    upcoming: tuple[T, ...]
    left: int


def bound(count: int) -> int:
    """How many answers a binary search between this many candidates needs at most, with both ends confirmed."""
    return min(count, 2) + (math.ceil(math.log2(count - 1)) if count > 2 else 0)


def boundary(
    candidates: Sequence[T],
    test: Callable[[T], Answer],
    *,
    rules: Rules = USUAL,
    known: Mapping[int, Sequence[Answer]] | None = None,
    watch: Callable[[Progress[T]], None] = lambda _: None,
) -> Boundary[T]:
    """Where candidates turn from good to bad; the first is said to be good, the last to be bad.

    `known` are answers at hand, by the place of the candidate. What `test` raises goes through.
    """
    line = Line(len(candidates), rules)
    asked: list[Asked[T]] = []
    for place, answers in (known or {}).items():
        for answer in answers:
            line.note(place, answer)
            asked.append(Asked(candidate=candidates[place], answer=answer, free=True))
    while (index := line.next()) is not None:
        after = tuple(candidates[each] for each in line.upcoming())
        watch(Progress(candidate=candidates[index], upcoming=after, left=line.left))
        answer = test(candidates[index])
        line.note(index, answer)
        asked.append(Asked(candidate=candidates[index], answer=answer))
    return told(line, candidates, asked)


def told(line: Line, candidates: Sequence[T], asked: Sequence[Asked[T]]) -> Boundary[T]:
    """What a line came to."""
    gap, refused = line.gap, line.refused
    there = refused is None and gap.good >= 0 and gap.bad < line.length
    return Boundary(
        good=candidates[gap.good] if there else None,
        bad=candidates[gap.bad] if there else None,
        between=tuple(candidates[gap.good + 1 : gap.bad]) if there else (),
        confidence=gap.mass,
        asked=tuple(asked),
        refused=refused,
        bound=bound(len(candidates)),
    )

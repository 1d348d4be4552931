"""What a candidate answers, and by what rules a search asks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

T = TypeVar("T")


class Answer(StrEnum):
    """What one test of a candidate came to; it is flaky where it was bad and good in one test."""

    GOOD = "good"
    BAD = "bad"
    FLAKY = "flaky"
    UNTESTABLE = "untestable"


class Refused(StrEnum):
    """Why there is nothing to be searched: an end is not what it was said to be."""

    GOOD_IS_BAD = "the good end is bad"
    BAD_IS_GOOD = "the bad end is good"
    GOOD_UNTESTABLE = "the good end cannot be tested"
    BAD_UNTESTABLE = "the bad end cannot be tested"


@dataclass(frozen=True, kw_only=True, slots=True)
class Rules:
    """How sure a search has to be, and how many candidates that cannot be tested it tries before it tells a range.

    `confidence` is the chance that the boundary told is the right one, given every answer and the flakiness seen.
    `looks` is how often a test looks before it answers `bad`: one that looks again at what failed does it twice.
    """

    confidence: float = 0.99
    patience: int = 8
    looks: int = 1


USUAL = Rules()


@dataclass(frozen=True, kw_only=True, slots=True)
class Asked(Generic[T]):
    """One answer, in the order of the search; `free` is whether it was known before."""

    candidate: T
    answer: Answer
    free: bool = False

"""Define the answers of a candidate, and the rules of a search."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

T = TypeVar("T")


class Answer(StrEnum):
    """The result of one test of a candidate. It is flaky if it was bad and good in one test."""

    GOOD = "good"
    BAD = "bad"
    FLAKY = "flaky"
    UNTESTABLE = "untestable"


class Refused(StrEnum):
    """The reason that there is nothing to search: an end is not as claimed."""

    GOOD_IS_BAD = "the good end is bad"
    BAD_IS_GOOD = "the bad end is good"
    GOOD_UNTESTABLE = "the good end cannot be tested"
    BAD_UNTESTABLE = "the bad end cannot be tested"


@dataclass(frozen=True, kw_only=True, slots=True)
class Rules:
    """The rules of a search: its confidence, and its patience with candidates that cannot be tested.

    `confidence` is the chance wanted that the boundary is right, given every answer and the flakiness seen. After
    `patience` untestable candidates the search reports a range.
    """

    confidence: float = 0.99
    patience: int = 8


USUAL = Rules()


@dataclass(frozen=True, kw_only=True, slots=True)
class Observation(Generic[T]):
    """One answer, in the order of the search. `free` is true if it was known before."""

    candidate: T
    answer: Answer
    free: bool = False

"""Tests the search for a good end between bad ones, and the count of what was not tried."""

from __future__ import annotations

import pytest

from harness.rootcause.bisection.good_end import WINDOWS, GoodEndSearch, Look
from harness.rootcause.search import Answer

BAD = Look(answer=Answer.BAD, failure="new")


def search(line: str, bad: int) -> tuple[int | None, GoodEndSearch, list[int]]:
    """Look for a good end along letters: `g` works, each other letter is a failure of its own, capitals untestable."""
    asked: list[int] = []

    def look(place: int) -> Look:
        asked.append(place)
        return look_of(line[place])

    searched = GoodEndSearch(len(line), bad, {bad: look_of(line[bad])}, look)
    return searched.find(()), searched, asked


def look_of(letter: str) -> Look:
    """Return the look that a letter stands for."""
    answer = Answer.GOOD if letter == "g" else Answer.UNTESTABLE if letter.isupper() else Answer.BAD
    return Look(answer=answer, failure=letter)


@pytest.mark.parametrize("width", [1, 2, 5])
@pytest.mark.parametrize("first", range(1, 60, 7))
@pytest.mark.parametrize("bad", [69, 65])
def test_range_between_two_other_failures(first: int, width: int, bad: int) -> None:
    """A range of good candidates between older and newer failures is found, however short."""
    line = "o" * first + "g" * width + "n" * (70 - first - width)
    found, _, asked = search(line, bad)
    assert found is not None
    assert line[found] == "g"
    assert len(asked) == len(set(asked)) <= 32


def test_range_beside_what_cannot_be_tested() -> None:
    """Candidates that cannot be resolved are the older side of a range just as well."""
    line = "U" * 40 + "gg" + "n" * 9
    found, _, _ = search(line, len(line) - 1)
    assert found is not None
    assert line[found] == "g"


def test_nothing_works() -> None:
    """The cost is bounded, and each range that was not tried is listed."""
    line = "n" * 200
    found, searched, asked = search(line, 199)
    assert found is None
    assert len(asked) <= 9 + WINDOWS
    left = [place for low, high in searched.untried() for place in range(low, high + 1)]
    assert sorted([*left, *asked, 199]) == list(range(200))


def test_guesses_come_first() -> None:
    """A guess that works costs one look."""
    asked: list[int] = []

    def look(place: int) -> Look:
        asked.append(place)
        return Look(answer=Answer.GOOD if place == 3 else Answer.BAD)

    assert GoodEndSearch(20, 19, {19: BAD}, look).find([19, 3]) == 3
    assert asked == [3]

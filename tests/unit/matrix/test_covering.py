"""Covering arrays: everything that can be covered is, in few rows, and always the same ones."""

import random
from itertools import combinations, product

import pytest

from harness.matrix.plan.covering import Row, covering, parts, uncovered_parts


def parts_of(rows: list[Row], ways: int) -> set[object]:
    """Return every part that some row has."""
    return {part for row in rows for part in parts(row, ways)}


def some_rows(seed: int) -> tuple[list[int], list[Row]]:
    """Return sizes of two to five axes, and part of their product, chosen at random."""
    chance = random.Random(seed)
    sizes = [chance.randint(1, 4) for _ in range(chance.randint(2, 5))]
    share = chance.choice([0.1, 0.3, 0.6, 0.9])
    every = list(product(*map(range, sizes)))
    return sizes, [row for row in every if chance.random() < share] or every[:1]


@pytest.mark.parametrize("ways", [1, 2, 3])
def test_every_allowed_part_is_covered(ways: int) -> None:
    """Only allowed rows come out, and no part of an allowed row is missed, however few rows are allowed."""
    for seed in range(150):
        sizes, allowed = some_rows(seed)
        strength = min(ways, len(sizes))
        chosen = covering(allowed, strength)

        assert set(chosen) <= set(allowed)
        assert parts_of(chosen, strength) == parts_of(allowed, strength)
        assert len(set(chosen)) == len(chosen)


def test_given_rows_stay_and_kept_ones_only_as_far_as_they_are_needed() -> None:
    """Rows that are there anyway are built upon; of others that resolved before, needless ones go."""
    for seed in range(150):
        _, allowed = some_rows(seed)
        chance = random.Random(seed)
        given = chance.sample(allowed, min(2, len(allowed)))
        kept = chance.sample(allowed, min(5, len(allowed)))
        chosen = covering(allowed, 2, given=given, preferred=kept)

        assert set(given) <= set(chosen) <= set(allowed)
        assert parts_of(chosen, 2) == parts_of(allowed, 2)
        for row in set(chosen) - set(given):
            assert parts_of([other for other in chosen if other != row], 2) != parts_of(chosen, 2)


def test_as_few_rows_as_the_two_largest_axes_need() -> None:
    """Pairs of 6 x 8 x 13 values fit into 8 x 13 rows, not 624; the same ones every time."""
    every = list(product(range(6), range(8), range(13)))

    assert len(covering(every, 2)) == 104
    assert covering(every, 2) == covering(every, 2)


def test_few_rows_where_little_is_allowed() -> None:
    """Rows are built towards what is allowed, so that none is needed for one pair alone: not 200, but some 30."""
    chance = random.Random(3)
    allowed = [row for row in product(range(4), repeat=6) if chance.random() < 0.05]

    assert len(allowed) > 150
    assert len(covering(allowed, 2)) < 40


def test_three_ways_take_more_than_two_and_less_than_all() -> None:
    """The more axes are taken together, the more rows."""
    every = list(product(range(3), repeat=5))

    assert 9 <= len(covering(every, 2)) < len(covering(every, 3)) < len(every)


def test_nothing_of_nothing() -> None:
    """If no row is allowed, none is chosen."""
    assert covering([], 2) == []


def test_uncovered_parts_are_listed_once() -> None:
    """Of a value that no row has, the pairs with it are not told again."""
    rows = [(0, 0, 0), (0, 1, 1)]

    assert uncovered_parts(rows, [2, 2, 2], 2) == [((0, 1),), ((1, 0), (2, 1)), ((1, 1), (2, 0))]
    assert uncovered_parts(list(product(range(2), repeat=3)), [2, 2, 2], 3) == []


def test_uncovered_is_what_covering_could_not_reach() -> None:
    """Every pair is either in a row that was chosen, or told."""
    for seed in range(50):
        sizes, allowed = some_rows(seed)
        chosen = covering(allowed, 2)
        missing = uncovered_parts(chosen, sizes, 2)
        for axes in combinations(range(len(sizes)), 2):
            for values in product(*(range(sizes[axis]) for axis in axes)):
                part = tuple(zip(axes, values, strict=True))
                told = part in missing or any((piece,) in missing for piece in part)
                assert told is (part not in parts_of(allowed, 2))

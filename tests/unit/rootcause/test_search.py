"""Bisection and delta debugging: what is asked, what is told, and how many answers it takes."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import pytest

from harness.rootcause.search import Answer, Boundary, Progress, Refused, Rules, Search, bound, boundary, minimise

GOOD, BAD, FLAKY, UNTESTABLE = Answer.GOOD, Answer.BAD, Answer.FLAKY, Answer.UNTESTABLE
RULES = Rules()


def alternating(*places: int) -> Callable[[int], Answer]:
    """Return a test that is good up to the first place, then bad up to the second, and so on."""
    return lambda index: BAD if sum(index >= place for place in places) % 2 else GOOD


@pytest.mark.parametrize("count", [2, 3, 8, 33])
def test_every_boundary_is_found(count: int) -> None:
    """Wherever it lies, both its neighbours are told; little more is asked than a binary search does, to be sure."""
    for place in range(1, count):
        found = boundary(range(count), alternating(place), rules=RULES)

        assert (found.good, found.bad, found.between, found.refused) == (place - 1, place, (), None)
        assert len(found.observations) <= 1.5 * bound(count) + 1
        assert found.confidence >= RULES.confidence


def test_the_bound_is_that_of_a_binary_search_with_both_ends() -> None:
    """Two ends, and the halvings between them."""
    assert [bound(count) for count in (1, 2, 3, 5, 9, 33)] == [1, 2, 3, 4, 5, 7]


@pytest.mark.parametrize(
    ("test", "refused"),
    [
        (lambda _: BAD, Refused.GOOD_IS_BAD),
        (lambda _: GOOD, Refused.BAD_IS_GOOD),
        (lambda index: UNTESTABLE if index == 0 else BAD, Refused.GOOD_UNTESTABLE),
        (lambda index: UNTESTABLE if index == 9 else GOOD, Refused.BAD_UNTESTABLE),
    ],
)
def test_an_end_that_is_not_what_was_claimed_is_refused(test: Callable[[int], Answer], refused: Refused) -> None:
    """Nothing is searched between ends that do not hold, and no boundary is told."""
    found = boundary(range(10), test, rules=RULES)

    assert (found.refused, found.good, found.bad) == (refused, None, None)
    assert len(found.observations) <= 7


def test_untestable_candidates_are_stepped_around() -> None:
    """Scattered candidates that cannot be tested hide no boundary that lies elsewhere."""
    for place in (3, 7, 12, 19):
        hidden = {2, 5, 8, 10, 11, 15} - {place, place - 1}
        found = boundary(
            range(24), lambda index, p=place, h=hidden: UNTESTABLE if index in h else alternating(p)(index)
        )

        assert (found.good, found.bad, found.between) == (place - 1, place, ())


def test_a_boundary_among_untestable_candidates_is_reported_as_a_range() -> None:
    """The neighbours are those that could be tested, and what lies between them is named."""
    found = boundary(range(24), lambda index: UNTESTABLE if 9 <= index <= 12 else alternating(11)(index))

    assert (found.good, found.bad, found.between) == (8, 13, (9, 10, 11, 12))


def test_a_long_block_that_cannot_be_tested_is_not_tried_whole() -> None:
    """Its ends are found, not each of its candidates."""
    found = boundary(
        range(200), lambda index: UNTESTABLE if 20 <= index < 180 else alternating(100)(index), rules=RULES
    )

    assert (found.good, found.bad) == (19, 180)
    assert len(found.observations) < 40


def test_several_boundaries_are_reported_as_a_chain() -> None:
    """Answers that contradict a single boundary are asked again; where they stand, each boundary is found."""
    found = boundary(range(40), alternating(10, 20, 30), rules=RULES, prior_answers={15: [BAD], 25: [GOOD]})

    assert [(turn.before, turn.after, turn.was, turn.becomes) for turn in found.chain] == [
        (9, 10, GOOD, BAD),
        (19, 20, BAD, GOOD),
        (29, 30, GOOD, BAD),
    ]
    assert (found.good, found.bad) == (29, 30)
    assert [(asked.candidate, asked.answer) for asked in found.observations if asked.candidate in {15, 25}].count(
        (25, GOOD)
    ) > 1


def test_one_wrong_answer_is_no_chain() -> None:
    """An answer that is not repeated when it is asked again is taken to be flaky."""
    wrong = {20: [GOOD]}
    found = boundary(range(40), alternating(12), rules=RULES, prior_answers=wrong)

    assert (found.good, found.bad, len(found.chain)) == (11, 12, 1)


def test_other_failures_in_between_are_reported_with_their_ends() -> None:
    """Other failures are stepped around, and the chain says where they begin and end."""
    search = Search(range(60), RULES)
    asked = 0
    while (index := search.next()) is not None:
        asked += 1
        other = 9 <= index < 45
        search.note(index, UNTESTABLE if other else alternating(30)(index), "import: no module" if other else None)
    found = search.result()

    assert (found.good, found.bad) == (8, 45)
    assert [(turn.before, turn.after, turn.was, turn.becomes) for turn in found.chain] == [
        (8, 9, GOOD, "import: no module"),
        (44, 45, "import: no module", BAD),
    ]
    assert asked <= 2 * bound(60)


def test_answers_at_hand_are_not_asked_again() -> None:
    """A search whose answers are all known asks nothing."""
    known = {0: [GOOD], 31: [BAD], 14: [GOOD], 15: [GOOD] * 3, 16: [BAD] * 4}
    found = boundary(range(32), alternating(16), rules=RULES, prior_answers=known)

    assert (found.good, found.bad) == (15, 16)
    assert all(one.free for one in found.observations)


def test_the_cheaper_candidate_is_preferred() -> None:
    """Of two candidates that tell about the same the cheaper one is asked."""
    dear = Search(range(33), RULES)
    cheap = Search(range(33), RULES, [0.0 if index == 14 else 1.0 for index in range(33)])
    for search in (dear, cheap):
        search.note(32, BAD)
        search.note(0, GOOD)

    assert dear.next() in {15, 16}
    assert cheap.next() == 14


def test_the_estimate_of_steps_left_comes_true() -> None:
    """The estimate falls to one, and is about what is really asked."""
    told: list[Progress[int]] = []
    found = boundary(range(64), alternating(20), rules=RULES, watch=told.append)

    assert abs(told[0].left - len(found.observations)) <= 3
    assert told[-1].left <= 2
    assert all(progress.candidate not in progress.upcoming for progress in told)
    followed = sum(after.candidate in now.upcoming for now, after in pairwise(told))
    assert followed >= len(told) - 2


def test_a_flaky_end_is_asked_until_it_stands() -> None:
    """A bad neighbour that looked good once is asked again, until the boundary is as sure as was asked for."""
    answers = iter([GOOD, BAD, BAD, BAD, BAD, BAD, BAD, BAD])
    asked: list[int] = []

    def test(index: int) -> Answer:
        asked.append(index)
        return next(answers) if index == 12 else alternating(12)(index)

    found = boundary(range(16), test, rules=RULES)

    assert (found.good, found.bad) == (11, 12)
    assert asked.count(12) >= 2
    assert found.confidence >= RULES.confidence


def test_a_doubt_costs_answers() -> None:
    """More confidence takes more answers, never fewer."""
    asked = [
        len(boundary(range(32), alternating(9), rules=Rules(confidence=p)).observations) for p in (0.9, 0.99, 0.9999)
    ]

    assert asked == sorted(asked)
    assert asked[0] < asked[-1]


# --- smallest sets ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("culprits", [{3}, {0}, {15}, {2, 11}, {0, 15}, {7, 8}, {1, 5, 14}])
def test_the_changes_that_cure_are_found(culprits: set[int]) -> None:
    """Of sixteen changes those that are needed together are told, and no other."""
    found = minimise(range(16), lambda chosen: GOOD if culprits <= set(chosen) else BAD, rules=RULES)

    assert found.items == tuple(sorted(culprits))
    assert not found.unsure
    assert len(found.observations) <= 2 * bound(17) * len(culprits)


def test_no_part_is_reported_if_all_changes_do_not_cure() -> None:
    """A whole that does not cure has no part that does."""
    found = minimise(range(8), lambda _: BAD, rules=RULES)

    assert found.items is None


def test_one_of_two_ways_is_enough() -> None:
    """If either of two changes is a cure, one of them is returned."""
    found = minimise(range(8), lambda chosen: GOOD if {2, 5} & set(chosen) else BAD, rules=RULES)

    assert found.items in {(2,), (5,)}


def test_changes_that_only_go_together_stay_together() -> None:
    """Two changes that resolve only together are both returned, and are not claimed to be the least that is needed."""

    def test(chosen: tuple[int, ...]) -> Answer:
        if (3 in chosen) != (6 in chosen):
            return UNTESTABLE
        return GOOD if 3 in chosen else BAD

    found = minimise(range(8), test, rules=RULES)

    assert found.items is not None
    assert {3, 6} <= set(found.items)
    assert found.unsure


# --- 200 worlds ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class World:
    """Packages of which a single release, or two together, break everything from there on."""

    seed: int
    releases: int
    broken: int
    missing: frozenset[int]
    flaky: float
    moody: float = 0.0

    def look(self, rng: random.Random, index: int) -> Answer:
        """Run once: a broken release looks good with the chance `flaky`, a good one bad with the chance `moody`."""
        if index in self.missing:
            return UNTESTABLE
        wrong = rng.random() < (self.flaky if index >= self.broken else self.moody)
        return BAD if (index >= self.broken) is not wrong else GOOD


def world(seed: int, *, flaky: float = 0.0, moody: float = 0.0) -> World:
    """Return the world of a seed, with 6 to 48 releases, of which one in seven cannot be installed."""
    rng = random.Random(f"world {seed}")
    releases = rng.randint(6, 48)
    missing = frozenset(index for index in range(1, releases - 1) if rng.random() < 1 / 7)
    return World(seed, releases, rng.randint(1, releases - 1), missing, flaky, moody)


def searched(one: World, confidence: float) -> Boundary[int]:
    """Return the boundary found in a world; its runs are seeded by the world."""
    rng = random.Random(f"runs {one.seed}")
    rules = Rules(confidence=confidence)
    return boundary(range(one.releases), lambda index: one.look(rng, index), rules=rules)


def count_runs(found: Boundary[int]) -> int:
    """Return how many runs it took; what cannot be installed is not run."""
    return sum(each.answer is not UNTESTABLE for each in found.observations)


def is_boundary(one: World, found: Boundary[int]) -> bool:
    """Return whether the boundary lies between the neighbours, and nothing between them could have told more."""
    told = found.good is not None and found.bad is not None and found.good < one.broken <= found.bad
    return told and set(found.between) <= one.missing


def test_single_culprits_of_100_worlds() -> None:
    """Each is found, and by no more runs than one and half as many again as a binary search needs at most."""
    worlds = [world(seed, flaky=0.0) for seed in range(100)]
    results = [(one, searched(one, 0.99)) for one in worlds]

    assert [one for one, found in results if not is_boundary(one, found)] == []
    assert all(count_runs(found) <= 1.5 * found.bound + 1 for _, found in results)
    assert sum(len(found.observations) for _, found in results) <= 1.5 * sum(found.bound for _, found in results)


def test_single_culprits_of_100_flaky_worlds() -> None:
    """Each culprit is found although one look in ten at a broken release is wrong, with environments near the bound."""
    worlds = [world(seed, flaky=0.1) for seed in range(100)]
    surely = [(one, searched(one, 0.999)) for one in worlds]

    assert [one for one, found in surely if not is_boundary(one, found)] == []
    assert sum(map(count_runs, (found for _, found in surely))) <= 2.1 * sum(found.bound for _, found in surely)
    environments = [len({one.candidate for one in found.observations}) for _, found in surely]
    assert sum(environments) <= 1.25 * sum(found.bound for _, found in surely)


def test_the_confidence_holds_where_good_releases_fail_now_and_then() -> None:
    """A bad answer is one look: a release that works nine times of ten moves hardly any boundary."""
    worlds = [world(seed, moody=0.1) for seed in range(200)]
    results = [(one, searched(one, 0.999)) for one in worlds]

    assert sum(not is_boundary(one, found) for one, found in results) <= 2


def test_pairs_of_100_worlds() -> None:
    """Two changes that only together break are both found, and no third is told."""
    for seed in range(100):
        rng = random.Random(f"pair {seed}")
        count = rng.randint(4, 30)
        pair = set(rng.sample(range(count), 2))
        found = minimise(range(count), lambda chosen, p=pair: GOOD if p <= set(chosen) else BAD, rules=RULES)

        assert set(found.items or ()) == pair
        assert len(found.observations) <= 4 * bound(count + 1)


def test_pairs_of_50_flaky_worlds() -> None:
    """Both culprits are found, but for one world, although one look in ten at a broken set is wrong."""
    wrong = []
    for seed in range(50):
        rng = random.Random(f"pair {seed}")
        count = rng.randint(4, 30)
        pair = set(rng.sample(range(count), 2))

        def test(chosen: tuple[int, ...], p: set[int] = pair, r: random.Random = rng) -> Answer:
            return BAD if not p <= set(chosen) and r.random() >= 0.1 else GOOD

        found = minimise(range(count), test, rules=Rules(confidence=0.999))
        if set(found.items or ()) != pair:
            wrong.append(seed)

    assert len(wrong) <= 1

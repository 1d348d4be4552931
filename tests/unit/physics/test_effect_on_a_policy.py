"""The effect of a change on a policy: intervals with known answers, their coverage, each effect, and the power."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from harness.model import replace
from harness.physics.consequence import (
    Effect,
    Play,
    bootstrap,
    consequence,
    effect,
    least_flips,
    newcombe,
    wilson,
)
from harness.physics.sentences import describe_consequence


def pairs(both: int, lost: int, gained: int, neither: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return successes before and after: so many in both, only before, only after, in neither."""
    before = np.repeat([True, True, False, False], [both, lost, gained, neither])
    after = np.repeat([True, False, True, False], [both, lost, gained, neither])
    return before, after


def play(returns: NDArray[np.float64], success: NDArray[np.bool_] | None = None) -> Play:
    """Return episodes with these returns, all from one start."""
    count = len(returns)
    return Play(starts=np.zeros((count, 2)), returns=returns, lengths=np.full(count, 10), success=success)


def successes(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> tuple[Play, Play]:
    """Return the episodes of both sides."""
    return play(before.astype(float), before), play(after.astype(float), after)


def test_intervals_are_those_of_the_literature() -> None:
    """Wilson's for 81 of 263 (Newcombe, 1998); the paired one as Fagerland, Lydersen and Laake print it, chapter 8."""
    assert wilson(81 / 263, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    before, after = pairs(both=59, lost=6, gained=16, neither=80)
    low, high = newcombe(after, before)
    assert (low, high) == pytest.approx((-0.1186, -0.0046), abs=5e-5)
    assert newcombe(before, after) == pytest.approx((-high, -low))


def test_without_a_flip_the_interval_is_not_empty() -> None:
    """200 of 200 on both sides leave room for 1.9 points: where nothing failed the correlation is not known."""
    low, high = newcombe(*pairs(200, 0, 0, 0))
    assert (low, high) == pytest.approx((-0.0188, 0.0188), abs=5e-5)


@pytest.mark.parametrize("share", [0.5, 0.82, 0.97])
@pytest.mark.parametrize("kept", [0.0, 0.6, 0.95])
def test_the_paired_interval_covers_the_truth(share: float, kept: float) -> None:
    """In 400 measurements of 200 pairs, from independent to nearly equal, 92 % and more hold the true difference."""
    dice = np.random.RandomState(3)
    truth, covered = -0.04, 0
    for _ in range(400):
        before = dice.random_sample(200) < share
        again = dice.random_sample(200) < share
        after = np.where(dice.random_sample(200) < kept, before, again)
        after &= dice.random_sample(200) >= -truth / share
        low, high = newcombe(before, after)
        covered += low <= truth <= high
    assert covered >= 0.92 * 400


def test_the_bootstrap_covers_the_truth() -> None:
    """In 300 measurements of 200 skewed differences, between 92 and 98 % hold the true mean."""
    dice = np.random.RandomState(4)
    covered = 0
    for _ in range(300):
        low, high = bootstrap(dice.standard_exponential(200) - 1.0)
        covered += low <= 0.0 <= high
    assert 0.92 <= covered / 300 <= 0.98


def test_pairs_tell_more_than_the_same_numbers_apart() -> None:
    """4 of 200 episodes that are lost, all others alike, are seen; shuffled, so that seeds no longer match, not."""
    dice = np.random.RandomState(5)
    returns = dice.normal(1000, 300, 200)
    before, after = play(returns), play(returns - 40)
    seen = consequence(before, after, 1000.0)
    apart = consequence(before, replace(after, returns=dice.permutation(after.returns)), 1000.0)
    assert seen is not None
    assert apart is not None
    assert (seen.effect, seen.difference) == (Effect.EQUAL, pytest.approx(-4.0))
    assert (apart.effect, apart.difference) == (Effect.UNTOLD, pytest.approx(-4.0))
    assert seen.high - seen.low < 0.01
    assert apart.high - apart.low > 5


@pytest.mark.parametrize(
    ("counts", "wanted"),
    [
        ((160, 38, 2, 0), Effect.WORSE),
        ((100, 1, 40, 59), Effect.BETTER),
        ((190, 2, 2, 6), Effect.EQUAL),
        ((90, 30, 25, 55), Effect.UNTOLD),
        ((200, 0, 0, 0), Effect.EQUAL),
    ],
)
def test_each_effect_on_success(counts: tuple[int, int, int, int], wanted: Effect) -> None:
    """Both, lost, gained, neither: of 200 episodes."""
    found = consequence(*successes(*pairs(*counts)), None)
    assert found is not None
    assert found.effect is wanted
    assert found.low <= found.difference <= found.high


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        (-3.0, -1.0, Effect.EQUAL),
        (-5.1, -1.0, Effect.WORSE),
        (1.0, 5.1, Effect.BETTER),
        (-5.0, 0.0, Effect.UNTOLD),
        (-4.9, 4.9, Effect.EQUAL),
        (-9.0, 9.0, Effect.UNTOLD),
    ],
)
def test_equal_needs_the_interval_inside(low: float, high: float, wanted: Effect) -> None:
    """An interval that lies inside is equal even without 0 in it; worse and better leave 0 out."""
    assert effect(low, high) is wanted


def test_the_least_flips_are_seen_four_times_in_five() -> None:
    """With the difference that is stated, about 80 % of 500 intervals leave out 0; with half of it, far fewer."""
    dice = np.random.RandomState(6)
    before, after = pairs(150, 10, 10, 30)
    least = least_flips(before, after)
    assert least == pytest.approx(0.1, abs=0.02)

    def power(difference: float) -> float:
        seen = 0
        for _ in range(500):
            lost, gained, _ = dice.multinomial(200, [0.05 + difference, 0.05, 0.9 - difference])
            seen += newcombe(*pairs(160 - lost, lost, gained, 40 - gained))[1] < 0
        return seen / 500

    assert 0.7 <= power(least) <= 0.9
    assert power(least / 2) < 0.45


def test_without_success_the_return_counts_in_parts_of_the_gain() -> None:
    """Half of the gain is 50 points; without a gain nothing is told, and episodes of another number are no pair."""
    returns = np.linspace(90, 110, 50)
    found = consequence(play(returns), play(returns - 100), 200.0)
    assert found is not None
    assert (found.measure, found.effect, found.difference) == ("return", Effect.WORSE, pytest.approx(-50.0))
    assert consequence(play(returns), play(returns), None) is None
    assert consequence(play(returns), play(returns[:40]), 200.0) is None


def test_equal_episodes_are_called_the_same() -> None:
    """The smallest difference is then that of one episode that is lost in 80 % of such measurements."""
    returns = np.linspace(90, 110, 200)
    found = consequence(play(returns), play(returns), 100.0)
    assert found is not None
    assert (found.identical, found.least) == (True, pytest.approx(0.80, abs=0.01))
    assert describe_consequence(found) == (
        "equal within 5 points: mean return of 200 episodes 100.0 before, 100.0 after (+0.0 points, +0.0 to +0.0); "
        "every episode is the same, to the bit; a difference of 0.8 points would have been seen"
    )


def test_a_sentence_says_all_that_was_seen() -> None:
    """Other starts and episodes that do not repeat are said, too."""
    before, after = successes(*pairs(163, 36, 0, 1))
    after = replace(after, starts=np.vstack([np.ones((3, 2)), np.zeros((197, 2))]), repeats=False)
    found = consequence(before, after, None)
    assert found is not None
    assert describe_consequence(found) == (
        "worse: 99.5 % of 200 episodes succeed before, 81.5 % after (-18.0 points, -23.9 to -12.8); "
        "a difference of 3.9 points would have been seen; 3 of the same seeds start elsewhere; "
        "an episode does not repeat itself"
    )

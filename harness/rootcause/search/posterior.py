"""Compute where a boundary may be if some answers are wrong: Bayes over places and rates of flakiness.

The candidates 0, 1, ... are good up to some place and bad from there on. A place `p` says that candidate `p` is the
first bad one: 0 means that all are bad, the number of candidates that none is. How often a bad candidate looks good,
and a good one bad, is unknown as well: each pair of rates is weighted by how well it fits the answers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

END = 0.05
"""What is given beforehand to an end that is not what it was said to be."""

# Not 0: that has no logarithm, and one wrong answer would rule out a place for good.
SELDOM = 0.001
BAD_LOOKS_GOOD = {SELDOM: 0.50, 0.05: 0.12, 0.1: 0.22, 0.2: 0.10, 0.4: 0.06}
GOOD_LOOKS_BAD = {SELDOM: 0.90, 0.05: 0.03, 0.1: 0.05, 0.2: 0.02}
"""Rates of flakiness, with how likely each is taken to be before anything was seen."""

RATES = tuple((b, g, p * q) for b, p in BAD_LOOKS_GOOD.items() for g, q in GOOD_LOOKS_BAD.items())


@dataclass(frozen=True, kw_only=True, slots=True)
class Posterior:
    """The probability of each place, and of seeing `bad` there: for a bad candidate, and for a good one.

    `rates` are the estimated rates of flakiness: a bad candidate looks good, a good one bad. `sums` are the sums of
    `mass` up to each place.
    """

    mass: tuple[float, ...]
    bad_if_bad: tuple[float, ...]
    bad_if_good: tuple[float, ...]
    rates: tuple[float, float]
    sums: tuple[float, ...]

    def within(self, first: int, last: int) -> float:
        """Return the probability that the place is from `first` to `last`, both included."""
        return self.sums[last + 1] - self.sums[first]

    def bad(self, index: int) -> float:
        """Return the probability that a candidate is bad."""
        return self.within(0, index)

    def gains(self) -> list[float]:
        """Return the information that a test of each candidate gives about the place, in bits."""
        rows = list(zip(self.mass, self.bad_if_bad, self.bad_if_good, strict=True))
        yes = list(accumulate(m * b for m, b, _ in rows))
        no = list(accumulate(m * g for m, _, g in rows))
        left = list(accumulate(m * _entropy(b) for m, b, _ in rows))
        right = list(accumulate(m * _entropy(g) for m, _, g in rows))
        return [
            max(0.0, _entropy(yes[i] + no[-1] - no[i]) - left[i] - (right[-1] - right[i]))
            for i in range(len(self.mass) - 1)
        ]


def compute_posterior(good: Sequence[int], bad: Sequence[int]) -> Posterior:
    """Return the probabilities of the places, after each candidate was seen good and bad so many times."""
    count = len(good)
    seen = [index for index in range(count) if good[index] or bad[index]]
    logs = [_likely([(good[index], bad[index]) for index in seen], *rates) for rates in RATES]
    # Only ratios matter, and the exponentials of many answers would underflow to 0 without `top`.
    top = max(map(max, logs))
    weights = [[math.exp(each - top) for each in row] for row in logs]
    stretches = list(zip(*weights, strict=True))  # between two that were seen nothing tells one place from another
    sizes = [high - low for low, high in zip([-1, *seen], [*seen, count], strict=True)]
    sums, yes, no = [sum(row) for row in stretches], [], []
    for row, whole in zip(stretches, sums, strict=True):
        yes.append(sum(weight * (1 - rate[0]) for weight, rate in zip(row, RATES, strict=True)) / whole)
        no.append(sum(weight * rate[1] for weight, rate in zip(row, RATES, strict=True)) / whole)
    inner = (1 - 2 * END) / max(count - 1, 1)
    prior = [END, *[inner] * (count - 1), END]
    mass = [chance * weight for chance, weight in zip(prior, _spread(sums, sizes), strict=True)]
    total = sum(mass)
    shown = [each / total for each in mass]
    shares = [sum(row) for row in weights]
    return Posterior(
        mass=tuple(shown),
        sums=tuple(accumulate(shown, initial=0.0)),
        bad_if_bad=tuple(_spread(yes, sizes)),
        bad_if_good=tuple(_spread(no, sizes)),
        rates=(
            sum(share * rate[0] for share, rate in zip(shares, RATES, strict=True)) / sum(shares),
            sum(share * rate[1] for share, rate in zip(shares, RATES, strict=True)) / sum(shares),
        ),
    )


def _likely(seen: Sequence[tuple[int, int]], missed: float, feigned: float, weight: float) -> list[float]:
    """Return the logarithms of the likelihood of the answers, for one pair of rates, in each stretch of places."""
    good_right, good_wrong = math.log(1 - feigned), math.log(missed)
    bad_right, bad_wrong = math.log(1 - missed), math.log(feigned)
    log_likelihoods = [math.log(weight) + sum(good * good_wrong + bad * bad_right for good, bad in seen)]
    for good, bad in seen:
        log_likelihoods.append(log_likelihoods[-1] + good * (good_right - good_wrong) + bad * (bad_wrong - bad_right))
    return log_likelihoods


def _spread(values: Sequence[float], sizes: Sequence[int]) -> list[float]:
    return [value for value, size in zip(values, sizes, strict=True) for _ in range(size)]


def _entropy(chance: float) -> float:
    if chance <= 0 or chance >= 1:
        return 0.0
    return -chance * math.log2(chance) - (1 - chance) * math.log2(1 - chance)

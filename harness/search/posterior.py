"""Where a boundary may be, given answers of which some may be wrong: Bayes over places and rates of flakiness.

The candidates 0, 1, ... are good up to some place and bad from there on. A place `p` says that candidate `p` is the
first bad one: 0 that all are bad, the number of candidates that none is. How often a bad candidate looks good, and a
good one bad, is not known either: each pair of rates is weighed by how well it fits what was answered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

END = 0.05
"""What is given beforehand to an end that is not what it was said to be."""

SELDOM = 0.002
BAD_LOOKS_GOOD = {SELDOM: 0.70, 0.05: 0.08, 0.1: 0.10, 0.2: 0.08, 0.4: 0.04}
GOOD_LOOKS_BAD = {SELDOM: 0.84, 0.05: 0.05, 0.1: 0.07, 0.2: 0.04}
"""Rates of flakiness, with how likely each is taken to be before anything was seen."""

RATES = tuple((b, g, p * q) for b, p in BAD_LOOKS_GOOD.items() for g, q in GOOD_LOOKS_BAD.items())


@dataclass(frozen=True, kw_only=True, slots=True)
class Posterior:
    """How likely each place is, and how likely an answer is `bad` there: of a bad candidate, and of a good one."""

    mass: tuple[float, ...]
    bad_if_bad: tuple[float, ...]
    bad_if_good: tuple[float, ...]
    rates: tuple[float, float]

    def within(self, first: int, last: int) -> float:
        """How likely the place is one of these."""
        return sum(self.mass[first : last + 1])

    def bad(self, index: int) -> float:
        """How likely a candidate is bad."""
        return self.within(0, index)

    def gains(self) -> list[float]:
        """What asking each candidate tells of the place, in bits."""
        told = list(zip(self.mass, self.bad_if_bad, self.bad_if_good, strict=True))
        yes = list(accumulate(m * b for m, b, _ in told))
        no = list(accumulate(m * g for m, _, g in told))
        left = list(accumulate(m * _entropy(b) for m, b, _ in told))
        right = list(accumulate(m * _entropy(g) for m, _, g in told))
        return [
            max(0.0, _entropy(yes[i] + no[-1] - no[i]) - left[i] - (right[-1] - right[i]))
            for i in range(len(self.mass) - 1)
        ]


def weighed(good: list[int], bad: list[int]) -> Posterior:
    """The places, where each candidate answered `good` and `bad` so many times."""
    count = len(good)
    inner = max(count - 1, 1)
    prior = [math.log(END), *([math.log((1 - 2 * END) / inner)] * (count - 1)), math.log(END)]
    logs = [[p + chance for p, chance in zip(prior, _likely(good, bad, *rates), strict=True)] for rates in RATES]
    top = max(map(max, logs))
    weights = [[math.exp(each - top) for each in row] for row in logs]
    whole = sum(map(sum, weights))
    mass = [sum(row[place] for row in weights) / whole for place in range(count + 1)]
    yes = [_mean(weights, place, [1 - b for b, _, _ in RATES]) for place in range(count + 1)]
    no = [_mean(weights, place, [g for _, g, _ in RATES]) for place in range(count + 1)]
    rates = tuple(
        sum(sum(row) * rate[side] for row, rate in zip(weights, RATES, strict=True)) / whole for side in (0, 1)
    )
    return Posterior(mass=tuple(mass), bad_if_bad=tuple(yes), bad_if_good=tuple(no), rates=(rates[0], rates[1]))


def _likely(good: list[int], bad: list[int], missed: float, feigned: float, weight: float) -> list[float]:
    """Logarithms of how likely the answers are at each place, for one pair of rates."""
    of_good = [g * math.log(1 - feigned) + b * math.log(feigned) for g, b in zip(good, bad, strict=True)]
    of_bad = [b * math.log(1 - missed) + g * math.log(missed) for g, b in zip(good, bad, strict=True)]
    rest = sum(of_bad)
    found = [math.log(weight) + rest]
    for before, after in zip(of_good, of_bad, strict=True):
        found.append(found[-1] + before - after)
    return found


def _mean(weights: list[list[float]], place: int, values: list[float]) -> float:
    whole = sum(row[place] for row in weights)
    if whole <= 0:
        return 0.5
    return sum(row[place] * value for row, value in zip(weights, values, strict=True)) / whole


def _entropy(chance: float) -> float:
    if chance <= 0 or chance >= 1:
        return 0.0
    return -chance * math.log2(chance) - (1 - chance) * math.log2(1 - chance)

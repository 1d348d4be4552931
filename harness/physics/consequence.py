"""Tell what a change does to a task: a policy plays the same seeds in two cells, and does worse, better, or as well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any, Literal

import numpy as np

from harness.physics.outputs import Array
from harness.physics.relation import Consequence, Effect

POINTS = 5.0
"""Points that an interval has to lie within for two cells to be equal."""

CONFIDENCE, POWER = 1.959964, 0.841621
"""Quantiles of the normal distribution: of an interval of 95 %, and of a power of 80 %."""

RESAMPLES = 4000
MOST_NUMBERS = 1 << 20
"""Samples of the differences, and the numbers of them that are held at once."""

SAME_START = 1e-3
"""Largest difference of two first observations of one start: releases settle in a reset with other rounding."""


@dataclass(frozen=True, kw_only=True)
class Play:
    """Episodes of a policy in one cell, in the order of their seeds; `success` is None where none is told.

    `repeats` is whether the first episode was the same when it was played once more.
    """

    starts: Array
    returns: Array
    lengths: Array
    success: Array | None = None
    repeats: bool = True

    @classmethod
    def of(cls, arrays: Mapping[str, Array], facts: Mapping[str, Any]) -> Play:
        """Return what a probe played, from the arrays and facts that it left."""
        has_success = bool((arrays["success"] >= 0).all())
        return cls(
            starts=arrays["start"],
            returns=arrays["return"].astype(float),
            lengths=arrays["length"],
            success=arrays["success"] > 0 if has_success else None,
            repeats=bool(facts.get("repeats", True)),
        )


def consequence(before: Play, after: Play, gain: float | None) -> Consequence | None:
    """Return what the change from one cell to the other does to a policy that played the same seeds in both.

    `gain` is the return that is worth 100 points; without it success has to be told. None where nothing can be
    compared.
    """
    if before.returns.shape != after.returns.shape:
        return None
    if before.success is not None and after.success is not None:
        measure: Literal["success", "return"] = "success"
        first, second, unit = before.success.astype(float), after.success.astype(float), 1.0
        low, high = newcombe(before.success, after.success)
        least = least_flips(before.success, after.success)
    elif gain:
        measure, first, second, unit = "return", before.returns, after.returns, float(gain)
        low, high = bootstrap((second - first) / unit)
        least = (CONFIDENCE + POWER) * float(np.std((second - first) / unit, ddof=1)) / sqrt(len(first))
    else:
        return None
    identical = all(
        np.array_equal(one, other) for one, other in ((before.returns, after.returns), (before.lengths, after.lengths))
    )
    if identical and measure == "return":
        least = 1 - 0.2 ** (1 / len(first))  # a loss of everything in this share of the episodes shows in one of them
    return Consequence(
        effect=effect(100 * low, 100 * high),
        measure=measure,
        episodes=len(first),
        before=float(first.mean()),
        after=float(second.mean()),
        difference=100 * float((second - first).mean()) / unit,
        low=100 * low,
        high=100 * high,
        least=100 * least,
        moved_starts=_moved_starts(before.starts, after.starts),
        identical=identical,
        repeats=before.repeats and after.repeats,
    )


def effect(low: float, high: float) -> Effect:
    """Return the effect whose interval of points this is. One that lies within the points is equal, even without 0."""
    if low > -POINTS and high < POINTS:
        return Effect.EQUAL
    if high < 0:
        return Effect.WORSE
    return Effect.BETTER if low > 0 else Effect.UNTOLD


def newcombe(before: Array, after: Array) -> tuple[float, float]:
    """Return the interval of 95 % of the difference of two paired shares, after less before.

    It joins Wilson's intervals of both by their correlation: method 10 of Newcombe, "Improved confidence intervals for
    the difference between binomial proportions based on paired data", Statistics in Medicine 17 (1998), 2635-2650.
    """
    first, second = after.astype(bool), before.astype(bool)
    count = len(first)
    both, neither = int((first & second).sum()), int((~first & ~second).sum())
    gained, lost = int((first & ~second).sum()), int((~first & second).sum())
    shares = (both + gained) / count, (both + lost) / count
    (low1, high1), (low2, high2) = (wilson(share, count) for share in shares)
    product = (both + gained) * (lost + neither) * (both + lost) * (gained + neither)
    excess = both * neither - gained * lost
    corrected = max(excess - count / 2, 0.0) if excess > 0 else float(excess)
    correlation = corrected / sqrt(product) if product else 0.0
    difference = shares[0] - shares[1]
    down, up = (shares[0] - low1, high2 - shares[1]), (high1 - shares[0], shares[1] - low2)
    low, high = (sqrt(max(a * a - 2 * correlation * a * b + b * b, 0.0)) for a, b in (down, up))
    return max(difference - low, -1.0), min(difference + high, 1.0)


def wilson(share: float, count: int) -> tuple[float, float]:
    """Return Wilson's score interval of 95 % of a share."""
    square = CONFIDENCE**2
    middle = share + square / (2 * count)
    half = CONFIDENCE * sqrt(share * (1 - share) / count + square / (4 * count * count))
    return (middle - half) / (1 + square / count), (middle + half) / (1 + square / count)


def least_flips(before: Array, after: Array) -> float:
    """Return the smallest difference of two paired shares that is seen with a power of 80 %.

    As many episodes as flipped both ways here are taken to flip by chance; the others flip one way. Then the power is
    that of McNemar's test in Connor, "Sample size for testing differences in proportions for the paired-sample design",
    Biometrics 43 (1987), 207-211.
    """
    count = len(before)
    gained, lost = int((after & ~before).sum()), int((before & ~after).sum())
    chance = 2 * min(gained, lost) / count
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        flips = chance + middle
        wanted = CONFIDENCE * sqrt(flips) + POWER * sqrt(max(flips - middle * middle, 0.0))
        low, high = (low, middle) if count * middle * middle > wanted * wanted else (middle, high)
    return high


def bootstrap(differences: Array) -> tuple[float, float]:
    """Return the interval of 95 % of the mean of paired differences, by resampling them (Efron, 1979)."""
    count = len(differences)
    dice = np.random.RandomState(0)  # its numbers are the same in every release of NumPy
    parts, size = [], max(1, MOST_NUMBERS // count)
    for done in range(0, RESAMPLES, size):
        chosen = dice.randint(0, count, (min(size, RESAMPLES - done), count))
        parts.append(differences[chosen].mean(axis=1))
    means = np.sort(np.concatenate(parts))
    beyond = round(0.025 * RESAMPLES)
    return float(means[beyond]), float(means[-1 - beyond])


def _moved_starts(first: Array, second: Array) -> int:
    """Return the number of episodes that do not start alike."""
    if first.shape != second.shape:
        return len(first)
    return int((~np.isclose(first, second, rtol=SAME_START, atol=SAME_START)).any(axis=1).sum())

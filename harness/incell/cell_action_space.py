"""Describe the actions of an environment, and draw them from a generator that gives the same ones everywhere."""

import numpy as np

LARGEST = 1e3
"""A bound beyond this is none; then actions lie between -1 and 1."""


def action_space_of(env):
    """Return the actions of an opened environment."""
    space = getattr(getattr(env, "raw", None), "action_space", None)
    if hasattr(space, "n"):
        return Choices(int(space.n))
    if hasattr(space, "low"):
        return Bounds(space.low, space.high, space.shape, space.dtype)
    if hasattr(env, "low"):  # robosuite
        return Bounds(env.low, env.high, np.shape(env.low), float)
    spec = env.actions  # dm_control
    shape, far = spec.shape, 10 * LARGEST
    return Bounds(getattr(spec, "minimum", -far), getattr(spec, "maximum", far), shape, spec.dtype)


class Choices:
    """A number of choices."""

    is_discrete = True
    size = 1

    def __init__(self, count):
        self.count = count

    def draw(self, dice):
        """Return an action as an array of numbers."""
        return np.array([dice.randrange(self.count)], dtype=float)

    def as_action(self, values):
        """Return an action as the environment takes it."""
        return int(values[0])

    def describe(self):
        """Return what two releases have to have in common, as JSON."""
        return {"kind": "choices", "count": self.count}


class Bounds:
    """Numbers within bounds."""

    is_discrete = False

    def __init__(self, low, high, shape, kind):
        self.shape = tuple(shape)
        self.kind = np.dtype(kind)
        self.low = np.broadcast_to(np.asarray(low, dtype=float), self.shape).ravel()
        self.high = np.broadcast_to(np.asarray(high, dtype=float), self.shape).ravel()
        self.size = self.low.size

    def draw(self, dice):
        """Return an action as an array of numbers that float32 holds, too."""
        low = np.where(self.low <= -LARGEST, -1.0, self.low)
        high = np.where(self.high >= LARGEST, 1.0, self.high)
        drawn = low + (high - low) * np.array([dice.random() for _ in low])
        return np.asarray(drawn, dtype=np.float32).astype(float)

    def as_action(self, values):
        """Return an action as the environment takes it."""
        return np.asarray(values).astype(self.kind).reshape(self.shape)

    def describe(self):
        """Return what two releases have to have in common, as JSON: bounds as float32 has them."""
        low, high = (np.asarray(bound, dtype=np.float32).astype(float) for bound in (self.low, self.high))
        finite = [[float(number) if np.isfinite(number) else None for number in bound] for bound in (low, high)]
        return {"kind": "bounds", "shape": list(self.shape), "low": finite[0], "high": finite[1]}

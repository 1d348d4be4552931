"""Pictures: whether one shows what it should, and whether later ones follow what they show.

No rule here knows the environment, so each tells only of what cannot be right: see `followed` and `composed`.
"""

import numpy as np

from .cell_observed import remark

WINDOW = 5
"""Steps from one picture to the next."""

ENOUGH = 30
"""Steps over which observations have changed, and no picture, before that is told."""

NEAR = 40
"""How much each of the three parts of a colour, of 255, may differ from the one that was named."""

PART = 0.002
"""Of all pixels, those that make a colour part of the picture."""


def same(one, other):
    """Return whether two pictures are the same, pixel by pixel."""
    return one.shape == other.shape and bool((one == other).all())


def followed(env, draw, pictures, start, since, steps):
    """Look closer at two pictures that do not show the steps between them: a remark on what is wrong, or None.

    `start` are the values of the observation (see `values`) of the first, `since` is what `advance` said of
    the steps; `draw` returns a picture of `env`. Up to `steps` more are made.
    """
    (shown, picture), (latest, whole) = pictures, since
    count, at_resets = 0, False
    while True:
        if not same(picture, shown):
            if whole:
                return None
            at_resets = True
        elif changed(start, latest):
            if not same(draw(env), picture):
                return remark("stale", "render.stale.again")
            count += WINDOW if whole else 0
        if steps < WINDOW:
            break
        start, shown = latest, picture
        latest, whole = advance(env, WINDOW)
        picture = draw(env)
        steps -= WINDOW
    if count < ENOUGH:
        return None
    env.reset()
    if at_resets or not same(draw(env), picture):
        return remark("stale", "render.stale", steps=count)
    return remark("constant", "render.constant", steps=count)


def advance(env, steps):
    """Make some steps: the values of the last observation, and whether they were all of one episode."""
    observation, whole = None, True
    for _ in range(steps):
        observation, _, terminated, truncated = env.step(env.action())
        if terminated or truncated:
            observation = env.reset()
            whole = False
    return values(observation), whole


def values(observation):
    """Return all numbers of an observation, in their order, as arrays of their own; what is no number is left out."""
    if isinstance(observation, (tuple, list)):
        return [one for part in observation for one in values(part)]
    if hasattr(observation, "keys"):
        return [one for key in sorted(observation.keys(), key=str) for one in values(observation[key])]
    try:
        return [np.array(observation, dtype=np.float64)]
    except (TypeError, ValueError, RuntimeError):
        return []


def changed(before, after):
    """Return whether observations differ by more than a hair."""
    if [one.shape for one in before] != [one.shape for one in after]:
        return True
    with np.errstate(all="ignore"):  # a package may have asked numpy to raise
        return not all(np.allclose(*pair, rtol=1e-3, atol=1e-3) for pair in zip(before, after))


def composed(picture, above, below):
    """Look whether one colour lies above another one: a remark on what is wrong, or None.

    Colours are written `#rrggbb`, as a right picture has them. One that is missing makes the picture a wrong one.
    """
    heights = [_height(picture, colour) for colour in (above, below)]
    missing = [colour for colour, height in zip((above, below), heights) if height is None]
    if missing:
        return remark("picture", "render.colour_missing", promised=" or ".join(missing))
    if heights[0] < heights[1]:
        return None
    return remark("upside_down", "render.upside_down", above=above, below=below)


def marred(picture, never):
    """Look for a colour that no picture should show: a remark on what is wrong, or None."""
    if never is None or _height(picture, never) is None:
        return None
    return remark("picture", "render.colour_wrong", got=never)


def _height(picture, colour):
    """Return the mean row of all pixels of a colour; None where there are next to none."""
    wanted = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)])
    near = (abs(picture.astype(np.int64) - wanted) <= NEAR).all(axis=2)
    return float(near.nonzero()[0].mean()) if near.mean() >= PART else None

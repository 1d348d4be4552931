"""Check that a picture shows the right colours, and that pictures change with the environment; describe pictures.

No rule here knows the environment, so each reports only what cannot be right.
"""

import hashlib

import numpy as np

from .cell_observation import remark

WINDOW = 5
"""Steps from one picture to the next."""

ENOUGH = 30
"""Steps over which observations have changed, and no picture, before that is reported."""

NEAR = 40
"""How much each of the three parts of a colour, of 255, may differ from the one that was named."""

PART = 0.002
"""The fraction of all pixels that makes a colour part of the picture."""

PARTS = 3
"""Rows and columns of the grid whose fields have a mean colour each."""

DECIMALS = 3


def is_same(picture, other):
    """Return whether two pictures are the same, pixel by pixel."""
    return picture.shape == other.shape and bool((picture == other).all())


def compare_with_steps(env, draw, pictures, start, since, steps):
    """Compare pictures with the steps between them, and return a remark on what is wrong, or None.

    This looks closer at two pictures that do not show the steps between them.

    `start` are the values of the observation (see `observation_values`) of the first, `since` is the result of
    `make_steps` after it; `draw` returns a picture of `env`. Up to `steps` more steps are made.
    """
    (shown, picture), (latest, whole) = pictures, since
    count, at_resets = 0, False
    while True:
        if not is_same(picture, shown):
            if whole:
                return None
            at_resets = True
        elif observations_differ(start, latest):
            if not is_same(draw(env), picture):
                return remark("stale", "render.stale.again")
            count += WINDOW if whole else 0
        if steps < WINDOW:
            break
        start, shown = latest, picture
        latest, whole = make_steps(env, WINDOW)
        picture = draw(env)
        steps -= WINDOW
    if count < ENOUGH:
        return None
    env.reset()
    if at_resets or not is_same(draw(env), picture):
        return remark("stale", "render.stale", steps=count)
    return remark("constant", "render.constant", steps=count)


def make_steps(env, steps):
    """Make some steps and return the values of the last observation, and whether all were of one episode."""
    observation, whole = None, True
    for _ in range(steps):
        observation, _, terminated, truncated = env.step(env.action())
        if terminated or truncated:
            observation = env.reset()
            whole = False
    return observation_values(observation), whole


def observation_values(observation):
    """Return all numbers of an observation, in order, as float64 arrays; whatever is no number is left out."""
    if hasattr(observation, "keys"):
        observation = [observation[key] for key in sorted(observation.keys(), key=str)]
    if isinstance(observation, (tuple, list)):
        return [array for part in observation for array in observation_values(part)]
    try:
        return [np.array(observation, dtype=np.float64)]
    except (TypeError, ValueError, RuntimeError):
        return []


def observations_differ(before, after):
    """Return whether observations differ by more than a hair."""
    if [part.shape for part in before] != [part.shape for part in after]:
        return True
    with np.errstate(all="ignore"):  # a package may have asked numpy to raise
        return not all(np.allclose(*pair, rtol=1e-3, atol=1e-3) for pair in zip(before, after))


def check_colour_order(picture, above, below):
    """Check that one colour lies above another one, and return a remark on what is wrong, or None.

    Colours are written `#rrggbb`, as a right picture has them. One that is missing makes the picture a wrong one.
    """
    heights = [_height(picture, colour) for colour in (above, below)]
    missing = [colour for colour, height in zip((above, below), heights) if height is None]
    if missing:
        return remark("picture", "render.colour_missing", promised=" or ".join(missing))
    if heights[0] < heights[1]:
        return None
    return remark("upside_down", "render.upside_down", above=above, below=below)


def check_forbidden_colour(picture, never):
    """Check that a picture lacks a forbidden colour, and return a remark on what is wrong, or None."""
    if never is None or _height(picture, never) is None:
        return None
    return remark("picture", "render.colour_wrong", got=never)


def _height(picture, colour):
    """Return the mean row of all pixels of a colour; None where there are next to none."""
    wanted = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)])
    near = (abs(picture.astype(np.int64) - wanted) <= NEAR).all(axis=2)
    return float(near.nonzero()[0].mean()) if near.mean() >= PART else None


def picture_facts(frame):
    """Describe an array (height, width, 3) of uint8.

    `colours` counts pixels by the first of four levels of red, green and blue, as `"031"`; `means` are the mean colours
    of the fields of a grid, row by row from the top left, None for an empty one; `spread` is the standard deviation.
    """
    counts = [np.bincount(frame[:, :, part].ravel(), minlength=256) for part in range(3)]
    return {
        "shape": list(frame.shape),
        "sha256": hashlib.sha256(np.ascontiguousarray(frame).tobytes()).hexdigest(),
        "constant": all(int(count.max()) == int(count.sum()) for count in counts),
        "colours": _colours(frame),
        "means": [_mean(field) for row in np.array_split(frame, PARTS) for field in np.array_split(row, PARTS, axis=1)],
        "spread": _rounded([_spread(count) for count in counts]),
    }


def _colours(frame):
    levels = frame >> 6
    counts = np.bincount((levels[:, :, 0] * 16 + levels[:, :, 1] * 4 + levels[:, :, 2]).ravel(), minlength=64)
    return {"{}{}{}".format(n >> 4, n >> 2 & 3, n & 3): int(count) for n, count in enumerate(counts) if count}


def _mean(field):
    """Return a mean colour, by sums of columns: thirty times as fast as `mean` of both."""
    if not field.size:
        return None
    sums = field.sum(axis=0, dtype=np.uint32).sum(axis=0)
    return _rounded(sums / float(field.shape[0] * field.shape[1]))


def _spread(counts):
    """Return the standard deviation of levels that occur so often: a large picture has no room for more."""
    levels, total = np.arange(256), float(counts.sum())
    mean = (counts * levels).sum() / total
    return ((counts * (levels - mean) ** 2).sum() / total) ** 0.5


def _rounded(numbers):
    return [round(float(number), DECIMALS) for number in numbers]

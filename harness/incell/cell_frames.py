"""Describes a picture in numbers, at its full size, for whoever judges it later without the picture."""

import hashlib

import numpy as np

PARTS = 3
"""Rows and columns of the grid whose fields have a mean colour each."""

DECIMALS = 3


def described(frame):
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


def _rounded(values):
    return [round(float(value), DECIMALS) for value in values]

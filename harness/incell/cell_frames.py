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
    return {
        "shape": list(frame.shape),
        "sha256": hashlib.sha256(np.ascontiguousarray(frame).tobytes()).hexdigest(),
        "constant": bool((frame == frame[0, 0]).all()),
        "colours": _colours(frame),
        "means": [_mean(field) for row in np.array_split(frame, PARTS) for field in np.array_split(row, PARTS, axis=1)],
        "spread": _rounded([_spread(frame[:, :, part]) for part in range(3)]),
    }


def _colours(frame):
    levels = frame >> 6
    counts = np.bincount((levels[:, :, 0] * 16 + levels[:, :, 1] * 4 + levels[:, :, 2]).ravel(), minlength=64)
    return {"{}{}{}".format(n >> 4, n >> 2 & 3, n & 3): int(count) for n, count in enumerate(counts) if count}


def _mean(field):
    return _rounded(field.mean(axis=(0, 1))) if field.size else None


def _spread(part):
    """Return the standard deviation of a part of all colours, by counts: a large picture has no room for more."""
    counts, levels = np.bincount(part.ravel(), minlength=256), np.arange(256)
    mean = (counts * levels).sum() / float(part.size)
    return ((counts * (levels - mean) ** 2).sum() / part.size) ** 0.5


def _rounded(values):
    return [round(float(value), DECIMALS) for value in values]

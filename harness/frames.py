"""Frames that a probe rendered, kept as small PNGs."""

from __future__ import annotations

from pathlib import Path

WIDTH = 192
LARGEST = 64 << 20


def keep(array: Path, picture: Path) -> bool:
    """Turn an `.npy` of shape (height, width, 3) and dtype uint8 into a PNG at most 192 pixels wide.

    False where the file is not such an array: it comes out of a cell and is not trusted.
    """
    import numpy as np  # noqa: PLC0415 - only runs that render pay for it
    from PIL import Image  # noqa: PLC0415

    if not array.is_file() or array.stat().st_size > LARGEST:
        return False
    try:
        pixels = np.load(array, allow_pickle=False)
    except (ValueError, EOFError, OSError):
        return False
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        return False
    image = Image.fromarray(pixels)
    image.thumbnail((WIDTH, WIDTH))
    picture.parent.mkdir(parents=True, exist_ok=True)
    image.save(picture, optimize=True)
    return True

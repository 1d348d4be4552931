"""Turn frames that a probe rendered into small PNGs, and read those."""

from __future__ import annotations

import hashlib
import io
import re
from typing import TYPE_CHECKING, Any

from harness.model.hostile_data import Unreadable, raise_unreadable

if TYPE_CHECKING:
    from numpy.typing import NDArray

WIDTH = 192
LARGEST = 64 << 20

# numpy's own reader would evaluate the header as Python, and a hostile one nests without end.
ARRAY = re.compile(
    rb"\x93NUMPY(?:\x01\x00..|\x02\x00....)"
    rb"\{'descr': '\|u1', 'fortran_order': (True|False), 'shape': \((\d{1,9}), (\d{1,9}), 3\), \} *\n",
    re.DOTALL,
)
"""The first bytes of an `.npy` of bytes with three channels, as every numpy writes it; no other file is read."""


REMEMBERED = 256
"""Small pictures that are remembered: the cells of a matrix draw many equal frames."""


def thumbnail(content: bytes) -> bytes | None:
    """Turn an `.npy` of shape (height, width, 3) and dtype uint8 into a PNG at most 192 pixels wide.

    None where the bytes are not such an array: they come out of a cell and are not trusted.
    """
    name = hashlib.sha256(content).digest()
    try:
        return _by_digest[name]
    except KeyError:  # not made yet, or another thread has just cleared them
        picture = _thumbnail(content)
    if len(_by_digest) >= REMEMBERED:
        _by_digest.clear()
    _by_digest[name] = picture
    return picture


_by_digest: dict[bytes, bytes | None] = {}


def _thumbnail(content: bytes) -> bytes | None:
    header = ARRAY.match(content)
    if not header or len(content) > LARGEST:
        return None
    height, width = int(header[2]), int(header[3])
    if not height * width or len(content) - header.end() < height * width * 3:
        return None
    from PIL import Image  # noqa: PLC0415 - only runs that render pay for it

    pixels = memoryview(content)[header.end() : header.end() + height * width * 3]
    try:
        with raise_unreadable():
            if header[1] == b"True":  # the first index varies fastest: three planes, each of columns
                size = height * width
                planes = (Image.frombytes("L", (height, width), pixels[at * size : (at + 1) * size]) for at in range(3))
                image = Image.merge("RGB", [plane.transpose(Image.Transpose.TRANSPOSE) for plane in planes])
            else:
                image = Image.frombytes("RGB", (width, height), pixels)
            image.thumbnail((WIDTH, WIDTH))
    except Unreadable:
        return None
    written = io.BytesIO()
    image.save(written, "PNG", optimize=True)
    return written.getvalue()


def read(content: bytes) -> NDArray[Any]:
    """Return the pixels of a small PNG: (height, width, 3). Raises Unreadable."""
    import numpy as np  # noqa: PLC0415 - only reports of pictures pay for it
    from PIL import Image  # noqa: PLC0415

    with raise_unreadable():
        image = Image.open(io.BytesIO(content), formats=["PNG"])
        if max(image.size) > WIDTH:
            message = f"it is larger than {WIDTH} pixels"
            raise Unreadable(message)
        return np.asarray(image.convert("RGB"))

"""A frame that a cell drew becomes a small picture; nothing else does."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from harness.probes import thumbnails


def _npy(array: object) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)  # type: ignore[arg-type]
    return stream.getvalue()


def _npz() -> bytes:
    stream = io.BytesIO()
    np.savez(stream, a=np.zeros((4, 4, 3), np.uint8))
    return stream.getvalue()


def _header(text: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(100)


GOOD = np.random.default_rng(0).integers(0, 255, (30, 400, 3), np.uint8)


@pytest.mark.parametrize("array", [GOOD, np.asfortranarray(GOOD), GOOD.transpose(1, 0, 2), GOOD[:1, :1]])
def test_a_frame_becomes_a_picture(array: np.ndarray) -> None:
    """In whichever order its bytes lie, every pixel is where it was."""
    made = thumbnails.thumbnail(_npy(array))
    assert made
    with Image.open(io.BytesIO(made)) as picture:
        expected = Image.fromarray(np.ascontiguousarray(array))
        expected.thumbnail((thumbnails.WIDTH, thumbnails.WIDTH))
        assert np.array_equal(np.asarray(picture), np.asarray(expected))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x93NUMPY",
        _npz(),
        _npy(np.zeros((4, 4), np.uint8)),
        _npy(np.zeros((4, 4, 3), np.float32)),
        _npy(np.zeros((4, 0, 3), np.uint8)),
        _npy(GOOD)[:-1],
        _npy(np.array([object()], dtype=object)),
        _header("{'descr': '|u1', 'fortran_order': False, 'shape': (2000000, 2000000, 3), }\n"),
        _header("{'descr': '|u1', 'fortran_order': False, 'shape': (999999999, 999999999, 3), }\n"),
        _header("{'descr': '|u1', 'fortran_order': False, 'shape': (-4, -4, 3), }\n"),
        _header("{'descr': '|u1', 'fortran_order': False, 1: 2, 'shape': (4, 4, 3), }\n"),
        _header("(" * 5000),
        _header("-" * 9000 + "1"),
        b"PK\x03\x04" + bytes(100),
    ],
)
def test_anything_else_is_no_frame(content: bytes) -> None:
    """Archives, pickles, headers that promise terabytes or nest without end make no picture and raise nothing."""
    assert thumbnails.thumbnail(content) is None


def test_an_extreme_shape() -> None:
    """One pixel by twenty million is drawn, or refused, and raises nothing."""
    thumbnails.thumbnail(_npy(np.zeros((1, 20_000_000, 3), np.uint8)))

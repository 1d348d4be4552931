"""Test how much of a log is kept: both ends, every traceback once, and the amount left out."""

from __future__ import annotations

import io

import pytest

from harness.standalone.explain import failure_text, log_excerpt

LINE = b"Episode %07d: reward 1.5, all is well and goes on as it went before\n"
TRACE = b"""\
Traceback (most recent call last):
  File "train.py", line %d, in <module>
    fly()
OSError: no such folder

During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "train.py", line 9, in <module>
ValueError: no %s

"""


LITTLE = log_excerpt.Bounds(head=2560, tail=10_240, middle=10_240, chunk=10_240)
"""The bounds divided by one hundred, for quick tests."""


def log(count: int, *inside: bytes) -> bytes:
    """Return a long log with texts in its middle."""
    lines = [LINE % number for number in range(count)]
    lines[count // 2 : count // 2] = inside
    return b"".join(lines)


def test_a_short_text_is_kept_as_it_is() -> None:
    """Nothing is left out, nothing added."""
    text = log(10, TRACE % (1, b"wings"))
    assert log_excerpt.read_excerpt(io.BytesIO(text).read) == (text.decode(), len(text), 0)


@pytest.mark.parametrize("chunk", [2000, 7000, 10_240])
def test_a_long_text_keeps_its_ends_and_its_tracebacks(chunk: int) -> None:
    """Wherever the pieces end; the same traceback at another line not again and again; a chain stays a chain."""
    text = log(900, *(TRACE % (n, b"wings") for n in range(40)), TRACE % (3, b"wheels"))
    kept = log_excerpt.read_excerpt(io.BytesIO(text).read, LITTLE._replace(chunk=chunk))
    assert kept.size == len(text)
    assert kept.text.startswith(text[:1000].decode())
    assert kept.text.endswith(text[-1000:].decode())
    assert len(kept.text) < LITTLE.head + LITTLE.tail + LITTLE.middle
    assert 1 <= kept.text.count("ValueError: no wings") <= 6
    assert kept.text.count("ValueError: no wheels") == 1
    assert "During handling" in kept.text
    assert abs(kept.size - kept.missing - len(kept.text)) < 200
    assert failure_text.read_failure(kept.text).lines[0] == "ValueError: no wheels"


def test_no_traceback_is_lost_where_a_piece_ends() -> None:
    """Pieces end at every place of a traceback that occurs once, and each time it is kept to its last line."""
    raised = 'Traceback (most recent call last):\n  File "train.py", line 3, in fly\nKeyError: wheels\n'
    text = log(800, raised.encode() + b"\n")
    for chunk in range(2000, 2300):
        kept = log_excerpt.read_excerpt(io.BytesIO(text).read, LITTLE._replace(chunk=chunk))
        assert kept.text.count(raised) == 1, chunk


def test_an_endless_traceback_is_cut() -> None:
    """A traceback that never ends is not kept whole."""
    endless = (
        b"Traceback (most recent call last):\n"
        + b'  File "a.py", line 3, in recurse\n' * 1000
        + b"RecursionError: x\n\n"
    )
    kept = log_excerpt.read_excerpt(io.BytesIO(log(200) + endless + log(600)).read, LITTLE)
    assert len(kept.text) < sum(LITTLE)


def test_lines_without_an_end_are_kept_within_bounds() -> None:
    """A progress bar of many megabytes is one line."""
    kept = log_excerpt.read_excerpt(io.BytesIO(b"\r 10%|##   |" * 5000).read, LITTLE)
    assert (kept.size, len(kept.text) < 2 * (LITTLE.head + LITTLE.tail + LITTLE.chunk)) == (60_000, True)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"caf\xe9 \xff\n", "caf� �\n"),
        (b"\xef\xbb\xbfok\n", "ok\n"),
        ("Fähre\n".encode("utf-16"), "Fähre\n"),
        (b"nul\x00byte\n", "nulbyte\n"),
    ],
    ids=["broken", "bom", "powershell", "nul"],
)
def test_any_bytes_become_text(content: bytes, text: str) -> None:
    """Hurt UTF-8, and what PowerShell redirects."""
    assert log_excerpt.read_excerpt(io.BytesIO(content).read).text == text

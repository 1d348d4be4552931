"""Tests that no printed text holds characters that a terminal obeys."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from harness.standalone import output
from harness.standalone.control_characters import escape_json, strip_controls


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("plain\ttext\n", "plain\ttext\n"),
        ("Grüße ✔ 你好 👩‍🚀", "Grüße ✔ 你好 👩‍🚀"),
        ("a\x1b[31mred\x1b[0m", "ared"),
        ("a\x1b[2J\x1b[1;1Hb", "ab"),
        ("a\x1b]0;title\x07b", "ab"),
        ("a\x1b]52;c;ZXZpbA==\x1b\\b", "ab"),
        ("a\x1b]8;;http://evil.example\x07link\x1b]8;;\x07", "alink"),
        ("a\x1bPq#0\x1b\\b", "ab"),
        ("a\x1bcb", "ab"),
        ("a\x1b(0b", "ab"),
        ("a\x9b31mb", "ab"),
        ("a\x9d0;title\x9cb", "ab"),
        ("a\0\x0e\x0f\x7fb", "ab"),
        ("a\u202etxt.exe\u2066", "atxt.exe"),
        ("a\U000e0041b", "ab"),
        ("cut \x1b", "cut "),
        ("cut \x1b[3", "cut 3"),
        ("cut \x1b]0;no end", "cut 0;no end"),
        ("a\x1b\x00[31mb", "a[31mb"),
        ("a\rb\x08", "ab"),
    ],
)
def test_sequences_and_characters_are_removed(text: str, left: str) -> None:
    """Every kind of sequence goes, whole or cut off; text of any script stays."""
    assert strip_controls(text) == left
    assert strip_controls(left) == left


def test_json_stays_the_same_document() -> None:
    """Control characters are escaped in JSON, so that a program reads the original text."""
    plain = {"a": "x\x9b31m\u202e\x7f\U000e0041"}
    text = escape_json(json.dumps(plain, ensure_ascii=False))
    assert text.isascii()
    assert json.loads(text) == plain


@contextmanager
def guarded() -> Iterator[int]:
    """Let stdout be a guarded pipe; give its other end."""
    reading, writing = os.pipe()
    with pytest.MonkeyPatch.context() as patch, open(writing, "w", encoding="utf-8") as stream:  # noqa: PTH123
        patch.setattr(sys, "stdout", stream)
        output.guard()
        yield reading


def test_nothing_that_is_printed_moves_the_cursor() -> None:
    """Only a library that colours text which was made visible before writes sequences."""
    with guarded() as reading:
        print("a\x1b[1Abc\x9b")
        output.style_stream(sys.stdout).write("\x1b[32mgreen\x1b[0m\n")
        output.print_json(b'{"a": "\xc2\x9b"}')
        sys.stdout.flush()
        os.set_blocking(reading, False)
        assert os.read(reading, 1000) == b'abc\n\x1b[32mgreen\x1b[0m\n{"a": "\\u009b"}\n'
        os.close(reading)


def test_a_reader_that_has_gone_is_no_error() -> None:
    """Output after the end of a pipe goes nowhere."""
    with guarded() as reading:
        os.close(reading)
        print("much " * 100_000)
        sys.stdout.flush()
        print("more", flush=True)

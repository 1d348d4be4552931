"""Test how errors are printed: one line in a log, broken between words on a terminal."""

from __future__ import annotations

import sys

import pytest

from harness.__main__ import main

UNKNOWN = ["known", "no-such-package-and-no-such-issue-either"]


def test_in_a_log_an_error_is_one_line(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tools read it by lines, even where COLUMNS is set."""
    monkeypatch.setenv("COLUMNS", "40")

    assert main(UNKNOWN) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"simmatrix: {UNKNOWN[1]}: no package of this name was measured, and no known issue")


def test_on_a_terminal_no_word_is_cut(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The same words, in lines that fit; the command to type is whole."""
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    assert main(UNKNOWN) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) > 1
    assert max(map(len, lines)) <= 60

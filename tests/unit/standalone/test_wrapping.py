"""Sentences are wrapped at a terminal's width, and nothing else is."""

from __future__ import annotations

import io

import pytest

from harness.standalone.wrapping import width, wrap, wrap_lines

COMMAND = "next:      python -m pip install " + " ".join(f"package-{number}==1.0" for number in range(12))
SENTENCE = "cause:     " + " ".join(f"word-{number}" for number in range(30))


def test_sentences_are_broken_between_words() -> None:
    """They go on below the text, no word is cut or lost."""
    lines = list(wrap_lines([SENTENCE], 80))
    assert len(lines) > 1
    assert max(map(len, lines)) <= 80
    assert all(line.startswith(" " * 11) for line in lines[1:])
    assert " ".join(" ".join(lines).split()) == " ".join(SENTENCE.split())


def test_commands_stay_on_one_line() -> None:
    """A command that was broken could not be pasted."""
    assert list(wrap_lines([COMMAND], 80)) == [COMMAND]


def test_a_file_is_not_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless COLUMNS says how wide it is meant to be."""
    monkeypatch.delenv("COLUMNS", raising=False)
    assert width(io.StringIO()) is None
    assert list(wrap_lines([SENTENCE], None)) == [SENTENCE]
    monkeypatch.setenv("COLUMNS", "72")
    assert width(io.StringIO()) == 72


def test_a_command_in_backquotes_stays_whole() -> None:
    """It is copied: the break comes before it, though it does not fill the line then."""
    text = "no results on this machine; run `simmatrix run quickstart -j auto` first, or name a report"

    assert wrap(text, 50) == [
        "no results on this machine; run",
        "  `simmatrix run quickstart -j auto` first, or",
        "  name a report",
    ]


def test_an_empty_line_stays() -> None:
    """It parts two paragraphs."""
    assert wrap("", 40) == [""]

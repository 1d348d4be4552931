"""Text of packages in Markdown: no link, no picture, nobody called, nothing closed."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from harness.reports.text.markdown_texts import address, block, code, file_link, prose, table_cell


@pytest.mark.parametrize("made", [table_cell, prose])
@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("see [here](http://evil.example)", r"see \[here](http://evil.example)"),
        ("![i](http://evil.example/x.png)", r"!\[i](http://evil.example/x.png)"),
        ("![i][1]", r"!\[i]\[1]"),
        ("[1]: http://evil.example", r"\[1]: http://evil.example"),
        ("gymnasium[mujoco]==1.0", "gymnasium[mujoco]==1.0"),
        ("[Errno 2] gone", "[Errno 2] gone"),
        ("cc @everyone, (@all)", "cc @&#8203;everyone, (@&#8203;all)"),
        ("name @ https://x", "name @ https://x"),
        ("a@b.example", "a@b.example"),
        ("<img src=http://evil.example>", "&lt;img src=http://evil.example>"),
        ("`code [a](b) @x <b>`", "`code [a](b) @x <b>`"),
        ("`` ![p](u) `", r"`` !\[p](u) `"),
        ("``a` ![p](u) `b", r"``a` ![p](u) `b"),
        ("two\nlines", "two lines"),
    ],
)
def test_nothing_is_live(made: Callable[[str], str], text: str, shown: str) -> None:
    """Links, pictures, mentions and tags are texts; a code span is one by CommonMark's own rule."""
    assert made(text) == shown


def test_a_backslash_takes_no_backtick() -> None:
    """A backslash before a backtick is kept as a character of its own."""
    assert prose("\\`![p](u)`") == "\\\\`![p](u)`"
    assert table_cell("\\`a`|") == "\\\\`a`\\|"


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a", "`a`"), ("a`b", "`` a`b ``"), ("``", "``` `` ```"), ("a\n\n# b", "`a # b`")],
)
def test_a_code_span_ends_where_it_should(text: str, shown: str) -> None:
    """Its fence is longer than what it holds, and it is one line."""
    assert code(text) == shown


def test_no_line_ends_a_block() -> None:
    """The fence is longer than the longest run of backticks in the text."""
    assert block("a") == "```\na\n```"
    assert block("a\n````\n<b>", "pytb") == "`````pytb\na\n````\n<b>\n`````"


def test_only_addresses_and_files_are_links() -> None:
    """Anything else is a text."""
    assert address("https://example.org/a_(b)") == "<https://example.org/a_(b)>"
    assert address("javascript:x> ![p](u)") == "`javascript:x> ![p](u)`"
    assert file_link("lock", "locks/a-1.0+cpu.txt") == "[lock](locks/a-1.0+cpu.txt)"
    assert file_link("a", "http://evil.example") == "a"
    assert file_link("a", "x) ![p](u") == "a"

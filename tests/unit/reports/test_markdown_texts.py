"""Text of packages in Markdown: no link, no picture, nobody called, nothing closed."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from markdown_it import MarkdownIt

from harness.reports.text.markdown_texts import address, block, code, code_cell, file_link, prose, table_cell


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
        ("<img src=http://evil.example>", "`<img src=http://evil.example>`"),
        ("a <class 'str'> and <b>", "a `<class 'str'>` and `<b>`"),
        ("<img src=x onerror=y", "&lt;img src=x onerror=y"),
        ("a ` b <b> c", "a ` b &lt;b> c"),
        ("`a`<b>`c`", "`a`&lt;b>`c`"),
        ("<a`b>", "&lt;a`b>"),
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


@pytest.mark.parametrize(
    ("text", "shown"),
    [("", ""), ("a | <b>\n`c`", r"`` a \| <b> `c` ``"), ("![p](u) @x &lt;", "`![p](u) @x &lt;`")],
)
def test_a_line_in_a_table_is_code(text: str, shown: str) -> None:
    """It is one line and one cell, and can be copied as it was printed."""
    assert code_cell(text) == shown


HOSTILE = [
    "<script>alert(1)</script>", "`<script>`", "``<b>`", "\\`<b>`", "\\<b>", "`a`<b>", "<b>`a`", "a\\", "<b\n>",
    "![x](http://evil.example/a.png)", "[x]: http://evil.example", "<https://a.example>`<b>`", "<b>`", "`<b>", "<!--",
    "<a href='`'>b</a>`<i>`", "`` <b> ` <i> ``", "<b\\>`<i>", "&lt;b&gt;", "<?x?>", "|`|`|",
]  # fmt: skip
"""Texts of which each tries to get out of a code span or of prose; they are joined in pairs, too."""


@pytest.mark.parametrize("made", [table_cell, prose, code, code_cell])
def test_no_pair_of_hostile_texts_is_live(made: Callable[[str], str]) -> None:
    """A Markdown reader that follows CommonMark, with tables, sees neither HTML nor a picture nor a link to it."""
    reader = MarkdownIt("commonmark", {"html": True}).enable("table")
    for text in [f"{one}{between}{other}" for one in HOSTILE for other in HOSTILE for between in ("", " ", "a")]:
        page = f"| a | b |\n| - | - |\n| {made(text)} | end |\n" if made in {table_cell, code_cell} else made(text)
        tokens = reader.parse(page)
        kinds = [child.type for token in tokens for child in token.children or ()]
        assert not {"html_inline", "image"} & {*kinds}, (text, page)
        assert "html_block" not in [token.type for token in tokens], (text, page)
        links = [child.attrs["href"] for token in tokens for child in token.children or () if child.type == "link_open"]
        assert [link for link in links if link != "https://a.example"] == [], (text, page)
        if made in {table_cell, code_cell}:
            assert [token.content for token in tokens if token.type == "inline"][-1] == "end", (text, page)


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

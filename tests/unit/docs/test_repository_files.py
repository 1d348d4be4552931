"""Links of documents to files outside `docs/` lead to a page of the site, to the repository, or end the build."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).parents[3] / "docs" / "making" / "repository_files.py"
SPECIFICATION = importlib.util.spec_from_file_location("repository_files", PATH)
assert SPECIFICATION
assert SPECIFICATION.loader
repository_files = importlib.util.module_from_spec(SPECIFICATION)
SPECIFICATION.loader.exec_module(repository_files)

REPORT = "reports/quickstart/report.md"
GUIDE = ("docs/guides/try.md", "guides/try.md")


def lead(text: str, *, repository: str = "") -> str:
    """Return a guide's text with its links led, in a site that has one report and one more page."""
    return str(repository_files.lead_links(text, *GUIDE, {REPORT, "docs/concepts.md"}, repository))


def test_a_report_is_a_page_of_the_site() -> None:
    """Its link leads there, with its anchor."""
    assert (
        lead("[r](../../reports/quickstart/report.md#cells)") == "[r](../repository/reports/quickstart/report.md#cells)"
    )


def test_links_between_pages_stay() -> None:
    """The site generator checks them itself; so it does addresses and anchors of the same page."""
    for text in ("[c](../concepts.md#fix)", "[a](https://example.org/x)", "[h](#torch)"):
        assert lead(text) == text


def test_any_other_file_leads_to_the_repository() -> None:
    """Without its address the path is shown."""
    text = "[the matrix](../../matrices/quickstart.toml)"

    assert lead(text, repository="https://example.org/r") == (
        "[the matrix](https://example.org/r/blob/HEAD/matrices/quickstart.toml)"
    )
    assert lead(text) == "the matrix (`matrices/quickstart.toml`)"


def test_a_link_to_nothing_ends_the_build() -> None:
    """The message names the page and the link."""
    with pytest.raises(repository_files.MissingFile, match=r"docs/guides/try\.md: links to \.\./nothing\.toml"):
        lead("[x](../nothing.toml)")


def test_code_is_left_alone() -> None:
    """A link in a block or a span of code is text; a link whose words are code is a link."""
    block = "```\n[x](../nothing.toml)\n```\nand `[x](../nothing.toml)`"

    assert lead(block) == block
    assert lead("[`r`](../../reports/quickstart/report.md)") == "[`r`](../repository/reports/quickstart/report.md)"


def test_every_link_of_every_page_leads_somewhere() -> None:
    """Pages and reports that the site takes from the repository are found, and so are the pictures of these."""
    pages, pictures = repository_files.linked_files()

    assert REPORT in pages
    assert all((repository_files.ROOT / path).is_file() for path in pages | pictures)

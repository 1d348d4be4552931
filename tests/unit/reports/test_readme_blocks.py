"""Tables inside somebody's Markdown file."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.model.errors import BadInput
from harness.reports import readme_blocks

TEXT = """# A page

<!-- simmatrix report reports/one --pivot mujoco gymnasium -->
old
<!-- end -->

between

<!-- simmatrix report two -->
<!-- end -->
after
"""


def stand_in_report(source: Path, pivot: tuple[str, str] | None) -> str:
    """Return a stand-in for the report of a source and its pivot."""
    return f"{source.as_posix()} {pivot}\n"


def test_blocks_are_made_again() -> None:
    """Each block is filled from its own source, as seen from the file; what stands around it stays."""
    told = readme_blocks.renew_text(TEXT, Path("docs"), stand_in_report)

    assert told == (
        "# A page\n\n"
        "<!-- simmatrix report reports/one --pivot mujoco gymnasium -->\n\n"
        "docs/reports/one ('mujoco', 'gymnasium')\n\n"
        "<!-- end -->\n\nbetween\n\n"
        "<!-- simmatrix report two -->\n\ndocs/two None\n\n<!-- end -->\nafter\n"
    )
    assert readme_blocks.renew_text(told, Path("docs"), stand_in_report) == told


def test_a_file_is_renewed(tmp_path: Path) -> None:
    """The file is written only where something changed."""
    page = tmp_path / "page.md"
    page.write_text(TEXT)

    assert readme_blocks.renew(page, stand_in_report) == 0
    first = page.stat().st_mtime_ns, page.stat().st_ino
    assert readme_blocks.renew(page, stand_in_report) == 0
    assert (page.stat().st_mtime_ns, page.stat().st_ino) == first


def test_a_file_without_a_block(tmp_path: Path) -> None:
    """Whoever asks for it and has no block is told how one looks."""
    page = tmp_path / "page.md"
    page.write_text("nothing here\n")

    with pytest.raises(BadInput) as refused:
        readme_blocks.renew(page, stand_in_report)

    told = "has no table to update: `<!-- simmatrix report SOURCE -->`, below it `<!-- end -->`"
    assert str(refused.value) == f"{page}: {told}"


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    """A wrong path is bad input."""
    with pytest.raises(BadInput, match="cannot be read: No such file or directory"):
        readme_blocks.renew(tmp_path / "absent.md", stand_in_report)

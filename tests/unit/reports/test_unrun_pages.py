"""Pages in words, of runs that came to nothing: the machine lacks what cells need, or few of them were chosen."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.matrix import matrix_file
from harness.reports import document
from harness.reports.tables import tables
from harness.reports.text import author_pages
from harness.running import open_matrix

MATRICES = Path(__file__).parents[3] / "matrices"
PAGES = {
    path.stem: made.page
    for path in sorted(MATRICES.glob("*.toml"))
    if (made := matrix_file.read(path.read_text(encoding="utf-8"), path.name)).page
}


@pytest.mark.parametrize("matrix", PAGES)
def test_a_page_is_made_where_nothing_ran(matrix: str) -> None:
    """No version, no line that says why and no measurement is there, and yet the run ends with its page."""
    planned = open_matrix.load(matrix, lambda text: None)
    whole = document.build([], [planned], {"x86": {}}, "2026-11-22T00:00:00Z")

    page = author_pages.render((MATRICES / str(PAGES[matrix])).read_text(encoding="utf-8"), whole, tables.report(whole))

    assert page.lstrip().startswith("# ")

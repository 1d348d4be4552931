"""Update tables inside a user's Markdown file from the reports that the file itself names.

A block starts with `<!-- simmatrix report SOURCE [--pivot DOWN ACROSS] -->`, SOURCE as seen from the file's folder, and
ends with `<!-- end -->`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from harness.machine import store
from harness.machine.files import given_files
from harness.model.errors import BadInput

BLOCK = re.compile(
    r"^(?P<first><!-- simmatrix report (?P<source>\S+)(?: --pivot (?P<down>\S+) (?P<across>\S+))? -->)\n"
    r".*?^<!-- end -->$",
    re.DOTALL | re.MULTILINE,
)

Make = Callable[[Path, tuple[str, str] | None], str]
"""From a source and the axes of the pivot to the tables, as Markdown."""


def renew(file: Path, make: Make) -> int:
    """Make the blocks of a file again and return 0. Raises BadInput if it has none."""
    before = given_files.read_text(file)
    if not BLOCK.search(before):
        message = f"{file}: has no table to update: `<!-- simmatrix report SOURCE -->`, below it `<!-- end -->`"
        raise BadInput(message)
    after = renew_text(before, file.parent, make)
    if after != before:
        store.write_atomic(file, after.encode())
    return 0


def renew_text(text: str, folder: Path, make: Make) -> str:
    """Return a text that lies in a folder, with its blocks made again."""

    def block(match: re.Match[str]) -> str:
        pivot = (match["down"], match["across"]) if match["down"] else None
        return f"{match['first']}\n\n{make(folder / match['source'], pivot)}\n<!-- end -->"

    return BLOCK.sub(block, text)

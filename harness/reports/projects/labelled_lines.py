"""Write lines that begin with a label, and break them at the width of a terminal below their text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator

COMMAND = "simmatrix "


def labelled(label: str, text: str, width: int) -> str:
    """Return a line: the label within `width` columns, then the text."""
    return f"{label:<{width}}{text}"


def wrap_labelled(lines: Iterable[str], columns: int | None, width: int) -> Iterator[str]:
    """Yield lines broken between words, the rest below the text; a command to type stays on one line."""
    for line in lines:
        is_command = (line.startswith("  ") and line[2:width].strip()) or line[width:].startswith(COMMAND)
        if is_command or columns is None or len(line) <= columns:
            yield line
        else:
            # A package, a path or an option has to be copied whole.
            below = " " * width
            yield from textwrap.wrap(
                line, columns, subsequent_indent=below, break_long_words=False, break_on_hyphens=False
            )

"""Wrap sentences at the width of a terminal; what people copy stays on one line."""

from __future__ import annotations

import os
import re
import shutil
import textwrap
from typing import Iterable, Iterator, List, Optional, TextIO

SENTENCE = re.compile(r"^(?:cause|also|remedy|that is|warning|note|hidden by|because|derived): +")
NARROWEST = 40
QUOTED = re.compile(r"`[^`]+`")
KEPT_SPACE = "\ue000"
"""Stands for a space at which no line is broken: a character of the private area, which no text has."""


def width(stream: TextIO) -> Optional[int]:
    """Return the columns of the terminal that a stream is, or what $COLUMNS says; None where there is no limit."""
    if not stream.isatty() and not os.environ.get("COLUMNS", "").isdigit():
        return None
    return max(shutil.get_terminal_size().columns, NARROWEST)


def print_text(text: str, stream: TextIO) -> None:
    """Print a text; characters that the encoding of the stream lacks are replaced."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    print(text.encode(encoding, "replace").decode(encoding), file=stream, flush=True)


def wrap_lines(lines: Iterable[str], columns: Optional[int]) -> Iterator[str]:
    """Yield the lines; those that are sentences with a label are broken between words, the rest below the text."""
    for line in lines:
        label = SENTENCE.match(line)
        if columns is None or label is None or len(line) <= columns:
            yield line
        else:
            yield from wrap(line, columns, min(len(label.group(0)), NARROWEST // 2))


def wrap(line: str, columns: Optional[int], indent: int = 2) -> List[str]:
    """Break a line between words; what follows the first line is indented.

    No word is cut, not even at its hyphens, and no command in backquotes: people copy them whole.
    """
    if columns is None or len(line) <= columns:
        return [line]
    whole = QUOTED.sub(lambda command: command.group(0).replace(" ", KEPT_SPACE), line)
    below = " " * indent
    wrapped = textwrap.wrap(whole, columns, subsequent_indent=below, break_long_words=False, break_on_hyphens=False)
    return [text.replace(KEPT_SPACE, " ") for text in wrapped]

"""Remove from text the characters that a terminal would obey."""

from __future__ import annotations

import re

SEQUENCE = re.compile(
    "(?:\x1b\\[|\x9b)[0-?]*[ -/]*[@-~]"  # colours, movements of the cursor
    "|(?:\x1b[\\]PX^_]|[\x90\x98\x9d-\x9f])[^\x07\x1b\x9c\n]*(?:\x07|\x1b\\\\|\x9c)"  # titles, the clipboard, links
    "|\x1b[ -/]*[0-~]"  # sets of characters, a reset; the beginning of a sequence that was cut off
)
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\U000e0000-\U000e007f]")
"""C0 but for tab and line feed, C1, marks that turn the direction of writing, and tags, which nobody sees."""


def strip_controls(text: str) -> str:
    """Remove escape sequences and control characters; tabs and line feeds stay."""
    if text.isascii() and text.isprintable():
        return text
    # Sequences go first: without their first character the rest would stay as text.
    return CONTROL.sub("", SEQUENCE.sub("", text))


def escape_json(text: str) -> str:
    """Write what a terminal would obey as `\\uXXXX`, as JSON may; the document stays the same."""
    return CONTROL.sub(_escape, text)


def _escape(match: "re.Match[str]") -> str:
    # JSON writes a character beyond U+FFFF, such as a tag, as two units of UTF-16.
    units = match.group(0).encode("utf-16-be")
    return "".join("\\u{:02x}{:02x}".format(*units[place : place + 2]) for place in range(0, len(units), 2))

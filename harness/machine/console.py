"""Speak to the user beside the output that was asked for."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

MOST_WIDTH = 500


def tell(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr)


def limit_width(console: Console) -> Console:
    """Limit a console to `MOST_WIDTH` columns, because COLUMNS may say anything; return it."""
    console.width = min(console.width, MOST_WIDTH)
    return console

"""Speak to the user beside the output that was asked for."""

from __future__ import annotations

import sys


def tell(text: str) -> None:
    """Print a line on stderr."""
    print(text, file=sys.stderr)

"""Tell which packages' releases differ in a word, so that only their histories have to be opened."""

from __future__ import annotations

from typing import List

from .api_history import OF_IMPORT


def packages_with(kind: str, word: str) -> List[str]:
    """Return the packages whose releases differ in a word of a kind: `names`, `members` or `parameters`."""
    return sorted({*OF_IMPORT.values()})

"""Read requirements, specifiers and versions that somebody wrote, by `packaging` within its limits.

`packaging` reads a marker by recursion, and a number by `int`, which refuses more than 4,300 digits.
"""

from __future__ import annotations

import re
from functools import lru_cache

from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import InvalidVersion, Version

DEEPEST = 50
"""Parentheses that a marker may have."""

# Far above any real version, and far below the digits that `int` refuses.
LONG_NUMBER = re.compile(r"\d{100}")
TOO_LONG = "it has a number of too many digits"


@lru_cache(maxsize=4096)  # the lines of a file are read by several readers
def requirement(text: str) -> Requirement:
    """Read a requirement, which no caller may change. Raises InvalidRequirement."""
    _, _, marker = text.partition(";")
    if marker.count("(") > DEEPEST:
        message = "its marker is nested too deep"
        raise InvalidRequirement(message)
    if LONG_NUMBER.search(text):
        raise InvalidRequirement(TOO_LONG)
    return Requirement(text)


def specifiers(text: str) -> SpecifierSet:
    """Read a list of specifiers. Raises InvalidSpecifier."""
    if LONG_NUMBER.search(text):
        raise InvalidSpecifier(TOO_LONG)
    return SpecifierSet(text)


def version(text: str) -> Version:
    """Read a version. Raises InvalidVersion."""
    if LONG_NUMBER.search(text):
        raise InvalidVersion(TOO_LONG)
    return Version(text)

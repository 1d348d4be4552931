"""Parse requirements of packages, with extras, URL and markers (PEP 508)."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Iterable, Mapping

from .versions import canonical, specifiers


class Requirement:
    """A requirement: `name[extra]>=1; marker` or `name @ URL`. Raises ValueError."""

    __slots__ = ("extras", "marker", "name", "specifiers", "text", "url")

    def __init__(self, text: str) -> None:
        from .vendored.packaging.requirements import Requirement as Parsed  # noqa: PLC0415 - start-up

        parsed = Parsed(text)
        self.text = text
        self.name = canonical(parsed.name)
        self.extras = frozenset(map(canonical, parsed.extras))
        self.url = parsed.url
        self.specifiers = specifiers(str(parsed.specifier))
        self.marker = parsed.marker

    def wanted(self, environment: Mapping[str, str], extras: Iterable[str] = ()) -> bool:
        """Return whether the requirement applies in an environment, for one of the requested extras or for none.

        Raises ValueError for a comparison that means nothing.
        """
        if self.marker is None:
            return True
        values = {
            name: value + "local" * value.endswith("+") for name, value in environment.items()
        }  # 3.14.0+: a checkout
        return any(self.marker.evaluate({**values, "extra": extra}) for extra in ("", *extras))


def named(text: str) -> str:
    """Return the name of the package that a requirement is about, which is read without the rest."""
    match = re.match(r"\s*([A-Za-z0-9][\w.-]*)", text)
    return canonical(match.group(1)) if match else ""


@lru_cache(maxsize=None)
def requirement(text: str) -> Requirement:
    """Return the requirement, parsed once. Raises ValueError."""
    return Requirement(text)

"""Which adapter an environment id means, and what is tried of a package when no environment is named.

An adapter that declares no ids needs its name before an id, or `--api`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from functools import cache
from typing import NamedTuple

from harness.model.vocabulary import FAMILY, required_name
from harness.standalone.adapters import adapters, package


class Speaker(NamedTuple):
    """The package that brings an API, what its environment ids look like, and a small one that it always has."""

    api: str
    package: str
    ids: str
    example: str


@cache
def declared() -> tuple[Speaker, ...]:
    """Return a row for each adapter that declares what its environment ids look like."""
    return tuple(
        Speaker(api, package(api), adapter.ids, adapter.example) for api, adapter in adapters().items() if adapter.ids
    )


def brings_models(api: str) -> bool:
    """Tell whether an API's package brings models, which environments name as they would a file of the user's."""
    return api in adapters() and adapters()[api].brings_models


def speakers(requirements: Iterable[str]) -> tuple[Speaker, ...]:
    """The adapters whose own package is asked for, in that order; gym and gymnasium apart."""
    rows = {row.package: row for row in declared()}
    return tuple(rows[name] for name in dict.fromkeys(map(required_name, requirements)) if name in rows)


def spoken(env: str, requirements: Collection[str]) -> str | None:
    """The API of an id without one, by what is asked for: gym or gymnasium where that is named, the first of both."""
    named = next((name for name in map(required_name, requirements) if name in FAMILY), None)
    return named or meant(env, requirements)


def meant(env: str, requirements: Collection[str]) -> str | None:
    """The API that an id without one can only mean, by what is asked for: None where it may be another's, too."""
    if any(required_name(text) in FAMILY for text in requirements):
        return None
    found = [row.api for row in speakers(requirements) if re.fullmatch(row.ids, env)]
    return found[0] if len(found) == 1 else None

"""Find the adapter that an environment id means, and what to try of a package when no environment is named.

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
    """An API, the package that brings it, a pattern of its environment ids, and a small environment as example."""

    api: str
    package: str
    ids: str
    example: str


@cache
def declared_ids() -> tuple[Speaker, ...]:
    """Return a row for each adapter that declares what its environment ids look like."""
    return tuple(
        Speaker(api, package(api), adapter.ids, adapter.example) for api, adapter in adapters().items() if adapter.ids
    )


def brings_models(api: str) -> bool:
    """Tell whether an API's package brings models, which environments name as they would a file of the user's."""
    return api in adapters() and adapters()[api].brings_models


def speakers(requirements: Iterable[str]) -> tuple[Speaker, ...]:
    """Return the adapters whose own package is required, in that order, without gym and gymnasium."""
    rows = {row.package: row for row in declared_ids()}
    return tuple(rows[name] for name in dict.fromkeys(map(required_name, requirements)) if name in rows)


def find_api(env: str, requirements: Collection[str]) -> str | None:
    """Return the API for an id that names none: gym or gymnasium, whichever is required first, else `guess_api`."""
    named = next((name for name in map(required_name, requirements) if name in FAMILY), None)
    return named or guess_api(env, requirements)


def guess_api(env: str, requirements: Collection[str]) -> str | None:
    """Return the only API that an id without one can mean, given the requirements; None if there may be others."""
    # Any package may register its ids with gym or gymnasium.
    if any(required_name(text) in FAMILY for text in requirements):
        return None
    apis = [row.api for row in speakers(requirements) if re.fullmatch(row.ids, env)]
    return apis[0] if len(apis) == 1 else None

"""Read the environments that an installed package registers, and order them for trials."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from packaging.utils import canonicalize_name

from harness.model.vocabulary import APIS

# A cell may answer anything, so neither the number nor the length of its texts is trusted.
MOST, LONGEST = 5000, 300
VERSION = re.compile(r"^(.*?)[-_]v(\d+)$")
ARGUMENTS = re.compile(r"missing \d+ required (?:positional|keyword-only) arguments?")


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """An environment that may become a case: `place` is its module, `lacking` the reason why it cannot be made.

    `imports` are modules that have to be imported for it to be known.
    """

    env: str
    api: str
    place: str = ""
    entry: str = ""
    lacking: str = ""
    imports: tuple[str, ...] = ()


def read(facts: Mapping[str, Any]) -> tuple[tuple[Candidate, ...], tuple[tuple[str, str], ...]]:
    """Read the answer of a cell: environments, and failed imports with reasons. Skip entries of another shape."""
    listed, failed = facts.get("environments"), facts.get("failed")
    plain = [each for each in listed[:MOST] if isinstance(each, dict)] if isinstance(listed, list) else []
    candidates = [_candidate({name: str(value)[:LONGEST] for name, value in each.items()}) for each in plain]
    troubles = failed.items() if isinstance(failed, dict) else ()
    return (
        tuple(each for each in candidates if each.env and each.api in APIS),
        tuple((str(module)[:LONGEST], str(why)[:LONGEST]) for module, why in troubles),
    )


def _candidate(fields: Mapping[str, str]) -> Candidate:
    module, entry = fields.get("module", ""), fields.get("entry", "")
    loop = fields.get("api") == "pettingzoo"
    return Candidate(
        env=fields.get("env", ""),
        api=fields.get("api", ""),
        place=module if loop else entry.partition(":")[0] or module,
        entry=entry,
        lacking=fields.get("lacking", ""),
        imports=() if loop or not module else (module,),
    )


def chosen_order(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the newest version of each candidate in the order of trials: one of each class first, then the rest.

    Without that, three of a first matrix would be three variants of one task.
    """
    newest: dict[tuple[str, str], Candidate] = {}
    for each in candidates:
        name = VERSION.match(each.env)
        key = (each.api, name[1] if name else each.env)
        previous = newest.get(key)
        if previous is None or _number(each.env) > _number(previous.env):
            newest[key] = each
    latest = list(newest.values())
    # In PettingZoo `rps_v2` and `rps.rps` make the same environment; the one without a version is the inner module.
    if any(VERSION.match(each.place) for each in latest if each.api == "pettingzoo"):
        latest = [each for each in latest if each.api != "pettingzoo" or VERSION.match(each.place)]
    first: dict[str, Candidate] = {}
    for each in latest:
        first.setdefault(each.entry or each.env, each)
    heads = list(first.values())
    return [*_spread(heads), *(each for each in latest if each not in heads)]


def _number(env: str) -> int:
    version = VERSION.match(env)
    return int(version[2]) if version else -1


def _spread(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates of different modules first, in turns."""
    by_place: dict[str, list[Candidate]] = {}
    for each in candidates:
        by_place.setdefault(each.place, []).append(each)
    rounds = max(map(len, by_place.values()), default=0)
    return [group[at] for at in range(rounds) for group in by_place.values() if at < len(group)]


def needs_arguments(why: str) -> bool:
    """Return whether an environment failed only because it takes arguments that nobody gave."""
    return ARGUMENTS.search(why) is not None


def ordered_extras(extras: Sequence[str], places: Iterable[str]) -> list[str]:
    """Return extras in the order in which they are tried: those called like a part of the package first, `all` last."""
    parts = {canonicalize_name(part) for place in places for part in place.split(".")}
    return sorted(extras, key=lambda extra: (extra == "all", canonicalize_name(extra) not in parts))

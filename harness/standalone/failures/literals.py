"""Find literals that a text must contain for a regular expression to match: looking for them first is quick."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Dict, FrozenSet, Iterator, List, Mapping, Sequence, Tuple

try:
    from re import _parser  # type: ignore[attr-defined]
except ImportError:  # before Python 3.11
    import sre_parse as _parser

Clause = FrozenSet[str]
"""Literals of which one at least has to be there."""

SHORTEST = 3
"""Characters of a literal that is worth looking for."""

MOST = 3
"""Clauses that are looked at of one pattern: the longest ones."""

WIDEST = 12
"""Literals of one clause."""


_remembered: Dict[str, Tuple[Clause, ...]] = {}


def remember(clauses_by_pattern: Mapping[str, Sequence[Sequence[str]]]) -> None:
    """Take the clauses of patterns that were parsed before: to parse them takes longer than to look for them."""
    _remembered.update({pattern: tuple(map(frozenset, those)) for pattern, those in clauses_by_pattern.items()})


@lru_cache(maxsize=None)
def clauses(pattern: str) -> Tuple[Clause, ...]:
    """Return clauses that hold for every text in which the pattern is found; none if nothing is known."""
    if pattern in _remembered:
        return _remembered[pattern]
    try:
        parsed = _parser.parse(pattern, re.MULTILINE)
        if (parsed.state if hasattr(parsed, "state") else parsed.pattern).flags & re.IGNORECASE:
            # `literal in text` compares letters as they stand, so it is no test for a pattern that ignores case.
            return ()
        candidates = [clause for clause in _of_sequence(list(parsed)) if _worth(clause)]
    except Exception:  # the parser is Python's own affair: what it gives may change, and without it all is slower only
        return ()
    return tuple(
        sorted(set(candidates), key=lambda literals: (-min(map(len, literals)), len(literals), sorted(literals)))[:MOST]
    )


def possible(pattern: str, text: str) -> bool:
    """Return whether a pattern can be found in a text; surely not where a literal of it is missing."""
    return all(any(literal in text for literal in clause) for clause in clauses(pattern))


def _worth(clause: Clause) -> bool:
    return 0 < len(clause) <= WIDEST and min(map(len, clause)) >= SHORTEST


def _of_sequence(items: Sequence[Tuple[Any, Any]]) -> Iterator[Clause]:
    """Yield the runs of literals in a sequence, and the literals that the parts between them need."""
    run: List[str] = []
    for operation, argument in items:
        if str(operation) == "LITERAL":
            run.append(chr(argument))
            continue
        if run:
            yield frozenset(("".join(run),))
            run = []
        yield from _of_one(str(operation), argument)
    if run:
        yield frozenset(("".join(run),))


def _of_one(operation: str, argument: Any) -> Iterator[Clause]:
    if operation == "SUBPATTERN":
        _, added, taken, items = argument
        # A group with flags of its own, such as `(?i:...)`, matches other letters than it shows.
        if not added and not taken:
            yield from _of_sequence(list(items))
    elif operation in {"MAX_REPEAT", "MIN_REPEAT"} and argument[0] >= 1:
        yield from _of_sequence(list(argument[2]))
    elif operation == "BRANCH":
        best = [_best(list(items)) for items in argument[1]]
        # One alternative without a literal matches where all the others are missing.
        if all(best):
            yield frozenset(literal for clause in best for literal in clause)


def _best(items: Sequence[Tuple[Any, Any]]) -> Clause:
    """Return the most telling clause of one alternative; an empty one if it has none."""
    candidates = [clause for clause in _of_sequence(items) if _worth(clause)]
    return max(candidates, key=lambda literals: min(map(len, literals))) if candidates else frozenset()

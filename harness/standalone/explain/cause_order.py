"""Put the causes of a failure in order: where each is seen in the text, and what was written down or derived of it."""

from __future__ import annotations

from typing import Any, Optional, Sequence, Tuple

from ..failures import matching
from ..failures.lines import shorten_line
from ..failures.matching import Diagnosis, Evidence
from .failure_text import Failure

DECISIVE, ELSEWHERE, LOG = 0, 1, 2
"""The place of a failure in a text: the decisive line, another one that says why, or anywhere."""


def find_hits(
    signatures: Sequence[matching.Signature], failure: Failure, killed: Optional[str]
) -> Tuple[Tuple[Diagnosis, ...], Tuple[Diagnosis, ...]]:
    """Return the known failures that the text shows, the deepest cause first, and those that it only mentions.

    What is written somewhere in a log, and in no line that says why, is no cause of an exception, nor of a command
    that failed without a word; unless that line is a mask, which hides what was written before.
    """
    if not failure.failed:
        signatures = [one for one in signatures if one.pattern is not None and not one.generic]
    seen = Evidence(phase=None, reasons=failure.lines, logs=(failure.text,), signal=killed)
    hits = sorted(matching.matches(signatures, seen), key=lambda hit: _rank(hit, failure))
    best = min([place_of(hit, failure) for hit in hits if not hit.signature.masks], default=LOG)
    wordless = failure.failed and not failure.marked and killed is None
    masked = any(hit.signature.masks and place_of(hit, failure) is DECISIVE for hit in hits)
    most = ELSEWHERE if best is not LOG or wordless or (failure.raised and not masked) else LOG
    mask = ELSEWHERE if failure.raised else LOG
    causes = tuple(hit for hit in hits if place_of(hit, failure) <= (mask if hit.signature.masks else most))
    return causes, tuple(hit for hit in hits if hit not in causes)


def _rank(hit: Diagnosis, failure: Failure) -> Tuple[Any, ...]:
    """Return the sort key of a hit: causes of the decisive line come before those found elsewhere."""
    phases = hit.signature.phases
    elsewhere = bool(phases) and failure.phase is not None and failure.phase not in phases
    return matching.rank(hit.signature, place_of(hit, failure), elsewhere)


def place_of(hit: Diagnosis, failure: Failure) -> int:
    """Return where a cause was seen: in the decisive line, in another that says why, or in the log."""
    # A failure known by its signal has no line. A pattern over frames belongs to the exception below them.
    if hit.signature.pattern is None or is_in(hit.seen, failure.decisive):
        return DECISIVE
    if failure.raised and hit.seen in "\n".join(map(shorten_line, failure.region.splitlines())):
        return DECISIVE
    return ELSEWHERE if any(is_in(hit.seen, line) for line in failure.lines) else LOG


def is_in(seen: str, line: Optional[str]) -> bool:
    """Return whether a line that was seen is, or is part of, another; both may be shortened."""
    if not line:
        return False
    # `shorten_line` may have cut either line, so each is looked for in the other.
    first = seen.rstrip("…")
    return first in line or line.rstrip("…") in first


def with_derived(hits: Sequence[Diagnosis], derived: Sequence[Diagnosis], failure: Failure) -> Tuple[Diagnosis, ...]:
    """Return documented and derived causes in one order.

    What a person wrote down for exactly this failure goes first; what a broad rule derives comes after all that is
    documented of this failure alone.
    """
    exact = [hit for hit in hits if _is_exact(hit) and place_of(hit, failure) is DECISIVE]
    specific = [hit for hit in hits if hit not in exact and not hit.generic and not hit.masks]
    rest = [hit for hit in hits if hit not in exact and hit not in specific]
    precise = [hit for hit in derived if not hit.generic]
    documented = [hit.seen for hit in (*exact, *specific)]
    broad = [hit for hit in derived if hit.generic and not any(is_in(seen, hit.seen) for seen in documented)]
    return (*exact, *precise, *specific, *broad, *rest)


def _is_exact(hit: Diagnosis) -> bool:
    """Return whether a person wrote down what to install instead, for exactly this failure."""
    return not hit.signature.generic and bool(hit.signature.plain.get("remedy", {}).get("requirements"))

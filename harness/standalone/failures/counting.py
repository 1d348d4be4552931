"""Choose, of all known failures that fit, those that count: one rule for documents, expectations and texts.

A known failure that masks others hides why something failed. It counts only where nothing else is known, and only where
it is what the failure says: of a mask that stands in a log alone, or behind which a reason was found, the reason is
told already. Of a line of which something specific is known, nothing general is told.
"""

from __future__ import annotations

from typing import Any, Iterable, List, NamedTuple, Tuple


class Fit(NamedTuple):
    """A known failure that fits. `seen` is the line that shows it, `says` whether that line says why it failed."""

    diagnosis: Any
    masks: bool
    generic: bool
    seen: str
    says: bool


def select_counting(fits: Iterable[Fit]) -> Tuple[Any, ...]:
    """Return the known failures that count, in the order given, which is the deepest cause first."""
    causes = _causes(fits)
    specific = {one.seen for one in causes if not one.masks and not one.generic and one.seen}
    return tuple(one.diagnosis for one in causes if one.masks or not (one.generic and one.seen in specific))


def nameable(fits: Iterable[Fit]) -> Tuple[Any, ...]:
    """Return the known failures that an expectation may name: those that count, and general ones of the same lines.

    So an expectation stays met when something more specific comes to be known of its failure.
    """
    return tuple(one.diagnosis for one in _causes(fits))


def _causes(fits: Iterable[Fit]) -> List[Fit]:
    """Return those that are no masks; masks that say why where there is nothing else."""
    there = list(fits)
    return [one for one in there if not one.masks] or [one for one in there if one.says]


def is_stated(seen: str, lines: Iterable[str]) -> bool:
    """Return whether one of the lines that say why is that by which a known failure was told."""
    return any(seen in line for line in lines)

"""Choose, of all known failures that fit, those that count: one rule for documents, expectations and texts.

A known failure that masks others hides why something failed. It counts only where nothing else is known, and only where
it is what the failure says: of a mask that stands in a log alone, or behind which a reason was found, the reason is
told already. Of a line of which something specific is known, nothing general is told.

Each diagnosis has `masks`, `generic`, and `seen`: the line that shows it.
"""

from __future__ import annotations

from typing import Any, Callable, Iterable, List, Tuple

Says = Callable[[Any], bool]
"""A function that returns whether a diagnosis was seen in a line that says why something failed."""


def select_counting(diagnoses: Iterable[Any], says: Says) -> Tuple[Any, ...]:
    """Return the diagnoses that count, in the order given, which is the deepest cause first."""
    causes = select_nameable(diagnoses, says)
    specific = {one.seen for one in causes if not one.masks and not one.generic and one.seen}
    return tuple(one for one in causes if one.masks or not (one.generic and one.seen in specific))


def select_nameable(diagnoses: Iterable[Any], says: Says) -> List[Any]:
    """Return the diagnoses that an expectation may name: those that count, and general ones of the same lines.

    So an expectation stays met when something more specific comes to be known of its failure.
    """
    fitting = list(diagnoses)
    return [one for one in fitting if not one.masks] or [one for one in fitting if says(one)]


def stated_in(lines: Iterable[str]) -> Says:
    """Return the function that tells whether one of the lines that say why is that which shows a diagnosis."""
    reasons = tuple(lines)
    return lambda diagnosis: any(diagnosis.seen in line for line in reasons)

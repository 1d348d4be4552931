"""Identify the failure of a red cell, to tell whether two cells failed in the same way."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from harness.judging.expectation import Judged
from harness.judging.known_failures import has_causes
from harness.model import Phase
from harness.model.vocabulary import CHANGING


@dataclass(frozen=True, kw_only=True, slots=True)
class Failure:
    """The first phase that failed, the known failures that count there, deepest first, and the decisive line."""

    phase: Phase | None
    causes: tuple[str, ...]
    line: str

    def same(self, other: Failure) -> bool:
        """Return whether both are the same failure: by the deepest cause if both have causes, else by the line."""
        if self.phase is not other.phase:
            return False
        if self.causes and other.causes:
            return self.causes[0] == other.causes[0]
        return CHANGING.sub("…", self.line) == CHANGING.sub("…", other.line)


def failure(judged: Judged, causes: Iterable[str]) -> Failure | None:
    """Return the failure of a cell; None if it works, or nothing is known about its packages.

    `causes` are the ids of the known failures that count. They are read only if the cell failed.
    """
    if not has_causes(judged.verdict):
        return None
    return Failure(phase=judged.phase, causes=tuple(causes), line=judged.decisive or "")

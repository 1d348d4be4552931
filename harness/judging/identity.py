"""Identify the failure of a red cell, to tell whether two cells failed in the same way."""

from __future__ import annotations

from typing import Any, Protocol

from msgspec import Struct

from harness.judging.expectation import Judged
from harness.judging.known_failures import Explained, has_causes, select_counting
from harness.model import Phase
from harness.model.vocabulary import CHANGING


class Failure(Struct, frozen=True, kw_only=True):
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


class Explainable(Judged, Explained[Any], Protocol):
    """A judged cell with the known failures that fit it: assessed, or as a document has it."""


def failure(cell: Explainable) -> Failure | None:
    """Return the failure of a cell; None if it works, or nothing is known about its packages."""
    if not has_causes(cell.verdict):
        return None
    causes = tuple(one.name for one in select_counting(cell))
    return Failure(phase=cell.phase, causes=causes, line=cell.decisive or "")

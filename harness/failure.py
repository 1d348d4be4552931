"""What a red cell failed of, so that two cells can be asked whether they failed of the same."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from harness.evidence import causes
from harness.model import Phase, Verdict
from harness.reporttypes import UNTOLD, CellEntry
from harness.signatures import Diagnosis
from harness.verdict import Judgement
from harness.vocabulary import CHANGING as CHANGING  # noqa: PLC0414 - others take it from here


@dataclass(frozen=True, kw_only=True, slots=True)
class Failure:
    """Where a cell failed first, the known failures that count there, deepest first, and the line that says why."""

    phase: Phase | None
    causes: tuple[str, ...]
    line: str

    def same(self, other: Failure) -> bool:
        """Whether both are the same failure: by the deepest cause that is known of both, else by the line."""
        if self.phase is not other.phase:
            return False
        if self.causes and other.causes:
            return self.causes[0] == other.causes[0]
        return CHANGING.sub("…", self.line) == CHANGING.sub("…", other.line)


def of(judged: Judgement, found: Iterable[Diagnosis]) -> Failure | None:
    """What a judged cell failed of; None where it works, or nothing was told of its packages."""
    known = causes({str(one.signature.id): one.signature.masks for one in found})
    return _failure(judged.verdict, judged.phase, known, judged.decisive)


def of_entry(cell: CellEntry) -> Failure | None:
    """What a cell of a document failed of."""
    known = causes({one.signature: one.masks for one in cell.diagnoses})
    return _failure(cell.verdict, cell.phase, known, cell.decisive)


def _failure(verdict: Verdict, phase: Phase | None, known: tuple[str, ...], line: str | None) -> Failure | None:
    if verdict is Verdict.WORKS or verdict in UNTOLD:
        return None
    return Failure(phase=phase, causes=known, line=line or "")

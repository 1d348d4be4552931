"""Find the known failures that fit a cell, and those that count: causes of a red one, silent issues of any."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol, TypeVar

from msgspec import Struct

from harness.matrix.signatures import Signature
from harness.model import Phase, Verdict
from harness.model.report_types import UNTOLD
from harness.standalone.failures import counting, silent
from harness.standalone.failures.matching import Around, Diagnosis, Evidence, diagnose

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Knowledge(Struct, frozen=True, kw_only=True):
    """All that failures are compared with, read only if there are any.

    `silent` returns the signatures of silent issues, for results without a failure; if it is None, all signatures are
    searched. `logs` returns the texts, none of them long, that are kept at a path of a record, by their names; `locked`
    returns the lines `name==version` of a lock.
    """

    signatures: Callable[[], tuple[Signature, ...]] = tuple
    logs: Callable[[str], Mapping[str, str]] = lambda _: {}
    locked: Callable[[str], tuple[str, ...]] = lambda _: ()
    silent: Callable[[], tuple[Signature, ...]] | None = None


NOTHING_KNOWN = Knowledge()


# --- those that fit --------------------------------------------------------------------------------------------


def has_causes(verdict: Verdict) -> bool:
    """Return whether a verdict can have causes: not if the cell works, or says nothing about packages."""
    return verdict not in UNTOLD and verdict is not Verdict.WORKS


def find_diagnoses(
    knowledge: Knowledge, around: Around, failures: Iterable[Evidence], shown: Iterable[Diagnosis] = ()
) -> tuple[Diagnosis, ...]:
    """Return the known failures that fit: those that misleading checks have shown, then the deepest cause."""
    first = tuple(shown)
    ids = {one.signature.id for one in first}
    diagnoses = diagnose(knowledge.signatures(), tuple(failures), around)
    return (*first, *(one for one in diagnoses if one.signature.id not in ids))


def shown_silent(
    lurks: Iterable[Signature], cases: Iterable[silent.CaseResult], lines: Mapping[str, str | None]
) -> Iterator[Diagnosis]:
    """Yield the silent issues that misleading checks have shown in cases; `lines` are those of checks that failed."""
    issues = {one.id: one for case in cases for one in silent.shown_issues(lurks, case, lines)}
    for issue in issues.values():
        phase = Phase(issue.check.partition(".")[0])
        yield Diagnosis(signature=issue, phase=phase, seen=lines[issue.check] or "", is_reason=True)


# --- those that count ------------------------------------------------------------------------------------------


class Explained(Protocol[T_co]):
    """A cell with the known failures that fit it, and the lines that say why it and its checks ended as they did."""

    @property
    def diagnoses(self) -> tuple[T_co, ...]:
        """Return the known failures that fit, the deepest cause first."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return the lines that say why."""


def select_counting(cell: Explained[T]) -> tuple[T, ...]:
    """Return the known failures that count in a cell, the deepest cause first."""
    return counting.select_counting(cell.diagnoses, counting.stated_in(cell.reasons))


def select_nameable(cell: Explained[T]) -> list[T]:
    """Return the known failures that an expectation may name."""
    return counting.select_nameable(cell.diagnoses, counting.stated_in(cell.reasons))

"""Find the known failures that fit a cell, and those that count: causes of a red one, silent issues of any."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from harness.matrix.signatures import Signature
from harness.model import Phase, Verdict
from harness.model.report_types import UNTOLD
from harness.standalone.failures import counting, matching, silent
from harness.standalone.failures.counting import Fit
from harness.standalone.failures.matching import Around, Diagnosis, Evidence, diagnose


@dataclass(frozen=True, kw_only=True, slots=True)
class Knowledge:
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


@dataclass(frozen=True, kw_only=True, slots=True)
class Packages:
    """The packages of a cell. `installed` is None if nothing was installed, `lock` is a path, if any."""

    installed: Mapping[str, str] | None
    requirements: tuple[str, ...]
    python: str
    lock: str | None

    def around(self, knowledge: Knowledge) -> Around:
        """Return the packages to match known failures against: the installed ones, else those required and locked."""
        locked = knowledge.locked(self.lock) if self.lock and self.installed is None else ()
        return Around(installed=self.installed, requirements=(*self.requirements, *locked), python=self.python)


# --- those that fit --------------------------------------------------------------------------------------------


def has_causes(verdict: Verdict) -> bool:
    """Return whether a verdict can have causes: not if the cell works, or says nothing about packages."""
    return verdict not in UNTOLD and verdict is not Verdict.WORKS


def find_diagnoses(
    knowledge: Knowledge, packages: Packages, failures: Iterable[Evidence], shown: Iterable[Diagnosis] = ()
) -> tuple[Diagnosis, ...]:
    """Return the known failures that fit: those that misleading checks have shown, then the deepest cause."""
    first = tuple(shown)
    ids = {one.signature.id for one in first}
    diagnoses = diagnose(knowledge.signatures(), tuple(failures), packages.around(knowledge))
    return (*first, *(one for one in diagnoses if one.signature.id not in ids))


def lurking(knowledge: Knowledge, packages: Packages) -> tuple[Signature, ...]:
    """Return the silent issues whose packages a cell has."""
    if packages.installed is None:
        return ()
    around = Around(installed=packages.installed, python=packages.python)
    return matching.lurking((knowledge.silent or knowledge.signatures)(), around)


def shown_silent(
    lurks: Iterable[Signature], cases: Iterable[silent.CaseResult], lines: Mapping[str, str | None]
) -> Iterator[Diagnosis]:
    """Yield the silent issues that misleading checks have shown in cases; `lines` are those of checks that failed."""
    issues = {one.id: one for case in cases for one in silent.shown_issues(lurks, case, lines)}
    for issue in issues.values():
        phase = Phase(issue.check.partition(".")[0])
        yield Diagnosis(signature=issue, phase=phase, seen=lines[issue.check] or "", is_reason=True)


# --- those that count ------------------------------------------------------------------------------------------


def select_counting(diagnoses: Iterable[Diagnosis], lines: Iterable[str]) -> tuple[Diagnosis, ...]:
    """Return the diagnoses that count. `lines` say why the cell and its checks ended as they did."""
    return counting.select_counting(_fits(diagnoses, lines))


def names(diagnoses: Iterable[Diagnosis], lines: Iterable[str]) -> tuple[str, ...]:
    """Return the ids by which an expectation may name the known failures of a cell, former ones among them."""
    nameable: tuple[Diagnosis, ...] = counting.nameable(_fits(diagnoses, lines))
    former = (old for one in nameable for old in one.signature.formerly)
    return (*(one.signature.id for one in nameable), *former)


def _fits(diagnoses: Iterable[Diagnosis], lines: Iterable[str]) -> Iterator[Fit]:
    reasons = tuple(lines)
    for diagnosis in diagnoses:
        signature = diagnosis.signature
        says = counting.is_stated(diagnosis.seen, reasons)
        yield Fit(diagnosis=diagnosis, masks=signature.masks, generic=signature.generic, seen=diagnosis.seen, says=says)

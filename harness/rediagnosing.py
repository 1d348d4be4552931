"""A stored report compared anew with the failures that are known now, from the evidence that lies beside it.

Nothing is judged or measured again: verdicts, phases and lines stay as they are. A remedy is proven only by a cell of
the report that was made by that very change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import msgspec

from harness import changes, document, verdict
from harness.evidence import Knowledge, causes, gathered, written
from harness.model import FAILING, Phase, Verdict
from harness.reporttypes import UNTOLD, CaseEntry, CellEntry, ChangeEntry, Document
from harness.signatures import Around, Evidence, Signature, diagnose, machine_applicable
from harness.verdict import Judgement

STEPS = (Phase.RESOLVE, Phase.INSTALL)

Logs = Callable[[str], Mapping[str, str]]


def diagnosed(made: Document, known: Knowledge) -> Document:
    """The document with the causes of its red cells as they are known now."""
    signatures = known.signatures()
    cells = [_changed(_diagnosed(cell, signatures, known.logs), signatures) for cell in made.cells]
    return msgspec.structs.replace(made, cells=changes.proven(cells))


def _diagnosed(cell: CellEntry, known: Iterable[Signature], logs: Logs) -> CellEntry:
    if cell.verdict in UNTOLD or cell.verdict is Verdict.WORKS:
        return cell
    around = Around(
        installed=cell.installed, requirements=cell.requirements, python=cell.python or cell.requested_python
    )
    found = diagnose(known, tuple(failures(cell, logs)), around)
    fitting = causes({str(one.signature.id): one.signature.masks for one in found})
    return msgspec.structs.replace(
        cell,
        diagnoses=tuple(document.diagnosis_entry(one) for one in found),
        as_expected=_as_expected(cell, fitting),
    )


def _as_expected(cell: CellEntry, found: tuple[str, ...]) -> bool | None:
    """Judged again where an expectation names a signature."""
    if cell.as_expected is None or cell.expectation is None:
        return cell.as_expected
    judged = Judgement(verdict=cell.verdict, phases=cell.phases, phase=cell.phase, decisive=cell.decisive)
    return verdict.fits(cell.expectation, judged, found)


def _changed(cell: CellEntry, known: Iterable[Signature]) -> CellEntry:
    """A changed cell with all the signatures of which the change is the remedy, word for word."""
    if cell.change is None:
        return cell
    same = [str(one.id) for one, remedy in machine_applicable(known) if _plain(cell.change) == changes.plain(remedy)]
    names = tuple(dict.fromkeys((*cell.change.remedy_of, *same)))
    return msgspec.structs.replace(cell, change=msgspec.structs.replace(cell.change, remedy_of=names))


def _plain(change: ChangeEntry) -> dict[str, object]:
    return dict(change.change)


# --- evidence --------------------------------------------------------------------------------------------------


def failures(cell: CellEntry, logs: Logs) -> Iterator[Evidence]:
    """The evidence of each phase that failed, in every case, as the document and what lies beside it hold it."""
    for phase in STEPS:
        if cell.phases.get(phase) in FAILING:
            kept = logs(cell.evidence) if cell.evidence and cell.phase is phase else {}
            yield gathered(phase, [cell.decisive], [*_findings(cell, phase, None), *kept.values()])
    for case in cell.cases:
        yield from _of_case(cell, case, logs)
    if cell.suite and cell.suite.outcome in FAILING:
        kept = logs(cell.suite.evidence) if cell.suite.evidence else {}
        yield gathered(Phase.SUITE, [cell.suite.decisive], written(kept, Phase.SUITE))


def _of_case(cell: CellEntry, case: CaseEntry, logs: Logs) -> Iterator[Evidence]:
    for phase, outcome in case.phases.items():
        if outcome in FAILING:
            checks = [name for name, how in case.checks.items() if how in FAILING and name.partition(".")[0] == phase]
            told = [line for name in checks for line in (case.reasons.get(name), case.masked.get(name))]
            kept = logs(case.evidence[phase]) if phase in case.evidence else {}
            said = [*_findings(cell, phase, case.case), *written(kept, phase)]
            yield gathered(phase, told or [case.decisive], said)


def _findings(cell: CellEntry, phase: Phase, case: str | None) -> list[str]:
    return [
        found.text
        for found in cell.findings
        if found.check.partition(".")[0] == phase and (case is None or case in found.cases)
    ]

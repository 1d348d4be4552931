"""A stored report compared anew with the failures that are known now, from the evidence that lies beside it.

Nothing is judged or measured again: verdicts, phases and lines stay as they are. A remedy is proven only by a cell of
the report that was made by that very change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import msgspec

from harness import changes, document, verdict
from harness.evidence import Knowledge, gathered, names, shown_silent, together, written
from harness.model import FAILING, Phase, Plan, Verdict
from harness.reporttypes import UNTOLD, CaseEntry, CellEntry, ChangeEntry, Document
from harness.signatures import Around, Evidence, Signature, diagnose, lurking, machine_applicable
from harness.standalone import silent
from harness.verdict import Judgement

STEPS = (Phase.RESOLVE, Phase.INSTALL)

Logs = Callable[[str], Mapping[str, str]]


def diagnosed(made: Document, known: Knowledge) -> Document:
    """Return the document with the causes of its red cells and the silent issues of its cases as known now."""
    signatures = known.signatures()
    current = {str(old): str(one.id) for one in signatures for old in one.formerly}
    cells = [_changed(_diagnosed(_renamed(cell, current), signatures, known), signatures) for cell in made.cells]
    return msgspec.structs.replace(made, cells=changes.proven(cells))


def _renamed(cell: CellEntry, current: Mapping[str, str]) -> CellEntry:
    """Return a cell that names known failures by the ids that they have now."""
    replace, expect, change = msgspec.structs.replace, cell.expectation, cell.change
    if expect and expect.signature and expect.signature in current:
        expect = replace(expect, signature=current[expect.signature])
    if change:
        change = replace(change, remedy_of=tuple(dict.fromkeys(current.get(name, name) for name in change.remedy_of)))
    return replace(cell, expectation=expect, change=change)


def placed(made: Document, plan: Plan) -> Document:
    """Return the document with titles, tables, roles and what is expected of red cells as a matrix has them now."""
    name, replace = plan.matrix, msgspec.structs.replace
    before = made.matrices.get(name)
    if before and before.axes != plan.axes:  # another matrix of this name
        return made
    entry = document.matrix_entry(plan)
    kept = replace(before, pivot=entry.pivot, title=entry.title) if before else entry
    planned = {cell.id: cell for cell in plan.cells}

    def brought(cell: CellEntry) -> CellEntry:
        of = planned.get(cell.id)
        placed = replace(cell, role=document.role(cell.id, cell.change, plan.variants))
        if of is None or cell.verdict in UNTOLD or cell.verdict is Verdict.WORKS:
            return placed
        return replace(placed, expectation=document.expectation(of))

    cells = tuple(brought(cell) if cell.matrix == name else cell for cell in made.cells)
    return replace(made, cells=cells, matrices={**made.matrices, name: kept})


def _diagnosed(cell: CellEntry, signatures: Iterable[Signature], known: Knowledge) -> CellEntry:
    lurks = _lurking(cell, signatures)
    cell = _looked_up(cell, lurks)
    if cell.verdict in UNTOLD or cell.verdict is Verdict.WORKS:
        return cell
    locked = known.locked(cell.lock) if cell.lock and cell.installed is None else ()
    around = Around(
        installed=cell.installed,
        requirements=(*cell.requirements, *locked),
        python=cell.python or cell.requested_python,
    )
    shown = shown_silent(lurks, list(map(exercised, cell.cases)), _lines(cell))
    found = together(shown, diagnose(signatures, tuple(failures(cell, known.logs)), around))
    return msgspec.structs.replace(
        cell,
        diagnoses=tuple(document.diagnosis_entry(one) for one in found),
        as_expected=_as_expected(cell, names(found)),
    )


def _lurking(cell: CellEntry, known: Iterable[Signature]) -> tuple[Signature, ...]:
    """Return the silent issues whose packages a cell has."""
    if cell.installed is None:
        return ()
    return lurking(known, Around(installed=cell.installed, python=cell.python or cell.requested_python))


def exercised(case: CaseEntry) -> silent.Exercised:
    """Return a case of a document as silent issues see it."""
    return silent.Exercised(
        env=case.env,
        api=case.api,
        phases={phase: str(how) for phase, how in case.phases.items()},
        checks={check: str(how) for check, how in case.checks.items()},
        opengl=bool(case.drawn),
    )


def _looked_up(cell: CellEntry, lurks: tuple[Signature, ...]) -> CellEntry:
    """Return a cell of which it is said anew which silent issues fit its cases and are neither shown nor refuted."""
    replace = msgspec.structs.replace
    cases = tuple(replace(one, unverified=silent.open_issues(lurks, exercised(one))) for one in cell.cases)
    phases = (name for name in cell.unverified if not name.startswith(silent.PREFIX))
    names = (name for case in cases for name in case.unverified)
    return replace(cell, cases=cases, unverified=tuple(dict.fromkeys((*phases, *names))))


def _lines(cell: CellEntry) -> dict[str, str | None]:
    """Return the misleading checks that failed, each with its line in the first case."""
    return {name: case.reasons.get(name) for case in reversed(cell.cases) for name in case.misleads}


def _as_expected(cell: CellEntry, found: tuple[str, ...]) -> bool | None:
    """Return whether a cell is as expected, judged again: its matrix may expect something else of it now."""
    if cell.as_expected is None:
        return None
    if cell.expectation is None:
        return cell.verdict is Verdict.WORKS
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

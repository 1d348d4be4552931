"""A stored report compared anew with the failures that are known now, from the evidence that lies beside it.

Nothing is judged or measured again: verdicts, phases and lines stay as they are. A remedy is proven only by a cell of
the report that was made by that very change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import msgspec

from harness import changes, document, entry_failures
from harness.judging import expectation, known_failures
from harness.judging.failure_texts import Logs, gathered, written
from harness.judging.known_failures import Knowledge, Packages, has_causes
from harness.model import FAILING, Phase, Plan
from harness.reporttypes import CaseEntry, CellEntry, ChangeEntry, Document
from harness.signatures import Evidence, Signature, machine_applicable
from harness.standalone import silent

STEPS = (Phase.RESOLVE, Phase.INSTALL)


def diagnosed(made: Document, known: Knowledge) -> Document:
    """Return the document with the causes of its red cells and the silent issues of its cases as known now."""
    signatures = known.signatures()
    current = {str(old): str(one.id) for one in signatures for old in one.formerly}
    cells = [_changed(_diagnosed(_renamed(cell, current), known), signatures) for cell in made.cells]
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
        if of is None or not has_causes(cell.verdict):
            return placed
        return replace(placed, expectation=document.expectation_entry(of))

    cells = tuple(brought(cell) if cell.matrix == name else cell for cell in made.cells)
    return replace(made, cells=cells, matrices={**made.matrices, name: kept})


def _diagnosed(cell: CellEntry, known: Knowledge) -> CellEntry:
    packages = Packages(
        installed=cell.installed,
        requirements=cell.requirements,
        python=cell.python or cell.requested_python,
        lock=cell.lock,
    )
    lurks = known_failures.lurking(known, packages)
    cell = _looked_up(cell, lurks)
    if not has_causes(cell.verdict):
        return cell
    shown = known_failures.shown_silent(lurks, list(map(exercised, cell.cases)), _lines(cell))
    found = known_failures.fitting(known, packages, failures(cell, known.logs), shown)
    standing = expectation.met(cell.expectation, cell, lambda: known_failures.names(found, entry_failures.said(cell)))
    return msgspec.structs.replace(
        cell,
        diagnoses=tuple(document.diagnosis_entry(one) for one in found),
        as_expected=None if cell.as_expected is None else standing,
    )


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

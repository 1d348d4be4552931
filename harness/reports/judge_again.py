"""Judge stored reports again from their evidence, with the readings, known issues and expectations of today.

Nothing is measured, and no process is started.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.judging.runs import case as judging
from harness.judging.runs import suite
from harness.machine import store
from harness.machine.console import tell
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import Store
from harness.model import CaseRecord, Cell, CellRecord, Plan, replace
from harness.model.errors import BadInput, CouldNotTell, HarnessError
from harness.model.hostile_data import Unreadable
from harness.model.report_types import CellEntry, Document, first_few, format_count
from harness.probes.vault import Vault
from harness.reports import behaviour, document, packs, publishing
from harness.reports.packs import Index, Packed
from harness.reports.pictures import boundaries as picture_boundaries
from harness.reports.text import progress
from harness.running import open_matrix
from harness.running.signatures import shipped_signatures
from harness.standalone.output import print_json

NAME = "report.json"
MOST_NAMED = 20
"""Cells that are named of those that cannot be judged again."""


@dataclass(frozen=True, kw_only=True, slots=True)
class JudgedReport:
    """A report judged again: its plans as they are today, and the new document."""

    folder: Path
    index: Index
    plans: tuple[Plan, ...]
    document: Document

    @property
    def unchanged(self) -> bool:
        """Return whether the document is the same as at the last judging."""
        return packs.sha256(document.encode(self.document)) == self.index.report


def main(folders: Sequence[Path], *, write: bool, as_json: bool) -> int:
    """Print what judging again changes in these reports, or write them anew.

    Return 0 if nothing changed or everything was written, 1 if something changed, 3 if evidence is gone. As JSON the
    combined document is printed, and the changes go to stderr.
    """
    altered, untold, documents = 0, 0, []
    for folder in progress.count_off(folders, "report"):
        index = packs.index(folder)
        if index is None or not all((folder / name).exists() for name in index.packs):
            untold += 1
            _tell_untold(folder)
            continue
        with scratch_folder() as state:
            again = judge(folder, index, Store(state))
            lines = list(_altered(again))
            for line in lines:
                print(line, file=sys.stderr if as_json else sys.stdout)
            documents.append(document.relocate(again.document, publishing.seen_from_here(folder)))
            altered += bool(lines)
            if write:
                _write(again)
    if as_json and documents:
        print_json(document.encode(document.combine(documents)))
    print(f"{format_count(len(folders) - untold, 'report')} judged again, {altered or 'none'} altered", file=sys.stderr)
    return (1 if altered and not write else 0) or (CouldNotTell.exit_code if untold else 0)


def judge(folder: Path, index: Index, opened: Store) -> JudgedReport:
    """Return a report judged as of today from its evidence, which is unpacked into a store. Raises BadInput."""
    packed = packs.unpack(folder, index, opened.folder)
    vault = Vault(opened.folder)
    plans = _plans(packed)
    planned = {cell.id: cell for plan in plans for cell in plan.cells}
    judged_records = [_record(record, vault, folder) for one in packed for record in one.records]
    records = [replace(record, cell=planned.get(record.cell.id, record.cell)) for record in judged_records]
    machines = {name: facts for one in packed for name, facts in one.machines.items()}
    probes = {name: probe for one in packed for name, probe in one.probes.items()}
    knowledge, locate = shipped_signatures.load_knowledge(opened.folder), publishing.place(records, opened, folder)

    def build(generated: str) -> Document:
        document_made = document.build(records, plans, machines, generated, locate, probes, knowledge=knowledge)
        document_made = behaviour.add(document_made, records, plans, vault)
        return picture_boundaries.add(document_made, records, plans, vault)

    # The first build is as of the last judging: only with that instant can an unchanged report be equal to the byte.
    again = JudgedReport(folder=folder, index=index, plans=plans, document=build(index.judged))
    return again if again.unchanged else replace(again, document=build(store.now()))


def unpack_record(folder: Path, index: Index, cell: str, opened: Store) -> CellRecord:
    """Return the record of one cell of a report, judged from its evidence, which is unpacked into a store.

    Raises BadInput for evidence that is damaged or gone.
    """
    packed = packs.unpack(folder, index, opened.folder)
    record = next((record for one in packed for record in one.records if record.cell.id == cell), None)
    if record is None:
        message = f"{folder}: the evidence of {cell} is not in it"
        raise BadInput(message)
    return _record(record, Vault(opened.folder), folder)


def _record(record: CellRecord, vault: Vault, folder: Path) -> CellRecord:
    """Return the record of a cell with its runs judged again."""
    try:
        cases = tuple(_case(record, one, vault) for one in record.cases)
        tests = record.suite
        if tests and tests.runs:
            tests = suite.judged_again(vault.reading(name) for name in tests.runs)
    except Unreadable as error:
        message = f"{folder}: {record.cell.id}: a probe run of it: {error}"
        raise BadInput(message) from None
    return replace(record, cases=cases, suite=tests)


def _case(record: CellRecord, case_record: CaseRecord, vault: Vault) -> CaseRecord:
    if not case_record.runs:
        return case_record
    case = next(case for case in record.cell.cases if case.id == case_record.case)
    return judging.judged_again(case, [vault.reading(name) for name in case_record.runs])


def _plans(packed: Iterable[Packed]) -> tuple[Plan, ...]:
    """Return the plans of a report, with the cells as today's matrices have them where they are still the same."""
    plans = {plan.matrix: plan for one in packed for plan in one.plans}
    return tuple(map(_today, plans.values()))


def _today(plan: Plan) -> Plan:
    try:
        open_matrix.locate(plan.matrix)
    except HarnessError:  # the matrix is not here
        return plan
    try:
        today = open_matrix.load(plan.matrix, lambda _: None, offline=True)
    except HarnessError as error:
        tell(f"{plan.matrix} is judged as it was planned, not as its matrix is today: {error}")
        return plan
    if today.axes != plan.axes:  # another matrix of this name
        return plan
    cells_by_id = {cell.id: cell for cell in today.cells}
    return replace(today, cells=tuple(_cell(cells_by_id.get(cell.id), cell) for cell in plan.cells))


def _cell(today: Cell | None, cell: Cell) -> Cell:
    """Return a cell with its expectation of today, if it is still the same cell."""
    return today if today and _without_words(today) == _without_words(cell) else cell


def _without_words(cell: Cell) -> Cell:
    """Return a cell without the texts that its matrix may reword: expectation, change, how to get missing software."""
    return replace(cell, expect=None, tried=None, bring=tuple(replace(each, say="") for each in cell.bring))


def _write(again: JudgedReport) -> None:
    """Write the report anew, and its index if the document changed."""
    words = again.plans[0].page if len(again.plans) == 1 else None
    publishing.write(again.document, again.folder, None, words)
    if not again.unchanged:
        sha = packs.sha256(document.encode(again.document))
        index = Index(judged=again.document.generated, report=sha, packs=again.index.packs)
        packs.write_index(again.folder, index)


# --- what is said ----------------------------------------------------------------------------------------------


def _tell_untold(folder: Path) -> None:
    path = folder / NAME
    cells = document.read_file(path).cells if path.is_file() else ()
    named = first_few([cell.id for cell in cells], MOST_NAMED)
    where = os.path.relpath(folder)
    print(f"{where}: its evidence is missing; not judged again: {named}", file=sys.stderr)


def _altered(again: JudgedReport) -> Iterator[str]:
    """Yield a line for each change in a cell's result; nothing if there is no document before."""
    path = again.folder / NAME
    if again.unchanged or not path.is_file():
        return
    before = {(cell.id, cell.machine): cell for cell in document.read_file(path).cells}
    lines = []
    for cell in again.document.cells:
        old = before.get((cell.id, cell.machine))
        changes = ["not in the report"] if old is None else list(_differences(old, cell))
        lines += [f"{cell.id}: {text}" for text in changes]
    yield from lines or [f"{os.path.relpath(again.folder)}: titles, tables or words, and no cell"]


def _differences(old: CellEntry, new: CellEntry) -> Iterator[str]:
    """Yield the changes in a cell's result."""
    for name in ("verdict", "phase", "decisive", "as_expected", "unverified"):
        before, now = getattr(old, name), getattr(new, name)
        if before != now:
            yield f"{name}: {before} -> {now}"
    causes = [[one.signature for one in cell.diagnoses] for cell in (old, new)]
    if causes[0] != causes[1]:
        yield f"causes: {', '.join(causes[0]) or 'none'} -> {', '.join(causes[1]) or 'none'}"
    for phase in {**old.phases, **new.phases}:
        if old.phases.get(phase) != new.phases.get(phase):
            yield f"{phase}: {old.phases.get(phase)} -> {new.phases.get(phase)}"
    if len(old.findings) != len(new.findings):
        yield f"findings: {len(old.findings)} -> {len(new.findings)}"

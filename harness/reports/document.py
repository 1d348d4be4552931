"""Make the report document (`report.json`) from records; write, read, move and combine such documents.

`harness.model.report_types` has the types.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import msgspec

from harness.judging import expectation
from harness.judging.assess import Assessed, assess
from harness.judging.assessed_case import AssessedCase
from harness.judging.known_failures import NOTHING_KNOWN, Knowledge
from harness.machine.files import given_files
from harness.matrix import changes
from harness.matrix.signatures import Signature
from harness.model import (
    Cell,
    CellRecord,
    Control,
    IndexSettings,
    Outcome,
    Phase,
    Plan,
    Repair,
    Role,
    Verdict,
    cellid,
    decoding,
    replace,
    schema,
)
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.model.report_types import (
    REPAIR,
    CaseEntry,
    CellEntry,
    ChangeEntry,
    DiagnosisEntry,
    Document,
    EditEntry,
    FindingEntry,
    MatrixEntry,
    RepairEntry,
    SubjectEntry,
    SuiteEntry,
)
from harness.reports.tables import change_effects
from harness.standalone.failures.matching import Diagnosis

T = TypeVar("T")

WITHOUT_TEXTS = frozenset({Outcome.PASSED, Outcome.SKIPPED, Outcome.UNAVAILABLE})
"""Outcomes of phases whose texts only the pack of evidence holds; a reader of the report asks for those of failures."""

Locate = Callable[[str], str]
"""From a path as records hold it (below the state folder) to one relative to the document."""


# --- making it -------------------------------------------------------------------------------------------------


def build(  # noqa: PLR0913 - all that a document is made of
    records: Iterable[CellRecord],
    plans: Sequence[Plan],
    machines: Mapping[str, Mapping[str, Any]],
    generated: str,
    locate: Locate = str,
    probes: Mapping[str, str] = MappingProxyType({}),
    *,
    knowledge: Knowledge = NOTHING_KNOWN,
) -> Document:
    """Judge every planned cell on every machine that measured it; a cell without a record gets an entry, too."""
    measured: dict[str, list[CellRecord]] = {}
    for record in records:
        measured.setdefault(record.cell.id, []).append(record)
    here = next(iter(machines)) if len(machines) == 1 else ""
    cells: list[CellEntry] = []
    stale = [sentence for plan in plans for sentence in plan.stale]
    planned = {cell.id: cell for plan in plans for cell in plan.cells}
    variants = frozenset().union(*(plan.variants for plan in plans))
    making = EntryInputs(locate, marks(), knowledge.signatures, planned, variants)
    for cell in planned.values():
        unrun = CellRecord(cell=cell, machine=here)
        for record in sorted(measured.get(cell.id, [unrun]), key=lambda record: record.machine):
            assessed = assess(record, knowledge, generated)
            cells.append(entry(assessed, making))
            stale += [assessed.stale] if assessed.stale else []
    return Document(
        generated=generated,
        machines={name: dict(facts) for name, facts in sorted(machines.items())},
        cells=change_effects.mark_proven(cells),
        dropped=tuple(gone for plan in plans for gone in plan.dropped),
        matrices={
            plan.matrix: MatrixEntry(
                axes=plan.axes, shown=plan.shown, snapshot=plan.snapshot, pivot=plan.pivot, title=plan.title or None
            )
            for plan in plans
        },
        stale=tuple(dict.fromkeys(stale)),
        probes=dict(probes),
    )


def role(cell_id: str, change: ChangeEntry | None, variants: Container[str], *, proving: bool = False) -> Role:
    """Return the role of a cell; a change that is the fix of a known issue, or proves one, is a repair."""
    if change is None:
        return Role.VARIANT if cell_id in variants else Role.MAIN
    return Role.REPAIR if proving or change.remedy_of or change.name == REPAIR else Role.WHAT_IF


def marks() -> Callable[[Cell], str]:
    """Return a function from a cell to a mark of what it asks for besides its axes.

    Other packages or other cases give another mark. The package index and its date are left out, because shards on two
    machines may differ in them.
    """
    cache: dict[tuple[int, ...], str] = {}

    def mark(cell: Cell) -> str:
        later = (cell.system, cell.empty, cell.python_path, cell.bring)
        key = tuple(map(id, (cell.question, cell.cases, cell.files, cell.needs, *later)))  # shared between cells
        if key not in cache:
            question = replace(cell.question, index=IndexSettings(), snapshot=None)
            # An empty later field adds nothing, so a cell without it keeps the mark that older reports hold.
            around = (cell.files, cell.needs, *filter(None, later))
            content = msgspec.json.encode((question, cell.cases, *around), order="deterministic")
            # A case without a bank of states, or a policy, has the mark that older reports hold.
            content = content.replace(b'"bank":null,', b"").replace(b'"policy":null,', b"")
            cache[key] = sha256(content).hexdigest()[:16]
        return cache[key]

    return mark


class EntryInputs(NamedTuple):
    """The inputs for the entries of a document; `signatures` returns the known failures."""

    locate: Locate
    mark: Callable[[Cell], str]
    signatures: Callable[[], tuple[Signature, ...]]
    planned: Mapping[str, Cell]
    variants: frozenset[str]


def entry(assessed: Assessed, making: EntryInputs) -> CellEntry:
    """Return a judged cell as a document entry."""
    record, locate = assessed.record, making.locate
    cell = record.cell
    change = _change(cell, making)
    return CellEntry(
        id=cell.id,
        matrix=cell.matrix,
        axes=dict(sorted(cell.axes.items())),
        python=record.python,
        requested_python=cell.python,
        machine=record.machine or None,
        environment=dict(cell.environment),
        supplied=dict(record.supplied),
        installed=dict(record.installed) if record.installed is not None else None,
        lock=locate(record.lock) if record.lock else None,
        lock_sha256=record.lock_sha256,
        key=record.key,
        measured=record.measured,
        reused=record.reused,
        inferred=False,
        attempts=assessed.attempts,
        seconds=round(float(record.seconds), 1),
        verdict=assessed.verdict,
        unverified=assessed.unverified,
        expected=cell.expect.verdict if cell.expect else Verdict.WORKS,
        as_expected=assessed.as_expected,
        repairs=tuple(map(_repair, record.repairs)),
        findings=tuple(
            FindingEntry(check=one.check, level=one.level, text=one.text, cases=cases)
            for one, cases in assessed.findings.items()
        ),
        phases={phase: assessed.phases[phase] for phase in Phase if phase in assessed.phases},
        cases=_cases(assessed, locate),
        decisive=assessed.decisive,
        diagnoses=tuple(map(diagnosis_entry, assessed.diagnoses)),
        evidence=locate(assessed.evidence) if assessed.evidence else None,
        phase=assessed.phase,
        expectation=cell.expect,
        requirements=cell.question.requirements,
        asked=making.mark(cell),
        subject=_subject(record),
        brought=record.brought or msgspec.UNSET,
        empty=cell.empty or msgspec.UNSET,
        suite=_suite(assessed, locate),
        controls=decoding.convert(record.controls, dict[str, Control], attributes=True) or msgspec.UNSET,
        base=cell.base,
        change=change,
        role=role(cell.id, change, making.variants, proving=bool(cell.tried and cell.tried.proving)),
    )


def _cases(assessed: Assessed, locate: Locate) -> tuple[CaseEntry, ...]:
    pairs = zip(assessed.cases, assessed.open_issues, strict=True)
    return tuple(_case(case, issues, locate) for case, issues in pairs)


def _change(cell: Cell, making: EntryInputs) -> ChangeEntry | None:
    """Return the change of a cell with the known failures that it is the remedy of; None for an unchanged cell."""
    tried, base = cell.tried, making.planned.get(cell.base or "")
    if tried is None:
        return None
    remedies = [(one.id, one.remedy.change) for one in making.signatures()] if base else []
    return ChangeEntry(
        name=tried.name,
        reason=tried.reason,
        does=(*changes.describe(tried.change), *tried.also),
        change=tried.change.plain,
        remedy_of=tuple(name for name, remedy in remedies if base and remedy and changes.produces(base, remedy, cell)),
        advice=tried.advice,
        link=tried.link,
    )


def diagnosis_entry(diagnosis: Diagnosis) -> DiagnosisEntry:
    """Return a known failure that fits as a document entry."""
    signature = diagnosis.signature
    return DiagnosisEntry(
        signature=signature.id,
        cause=signature.cause,
        remedy=signature.remedy.plain,
        proven=False,
        masks=signature.masks,
        references=signature.references,
        generic=signature.generic,
        phase=Phase(diagnosis.phase) if diagnosis.phase else None,
        seen=diagnosis.seen,
    )


def _repair(repair: Repair) -> RepairEntry:
    """Return the changes made to a release as a document entry."""
    built = repair.python is not None
    return RepairEntry(
        package=repair.name,
        version=repair.version,
        edits=tuple(EditEntry(field=edit.field, old=edit.old, new=edit.new) for edit in repair.edits),
        reason=repair.reason,
        link=repair.link,
        wheel_from_sha256=msgspec.UNSET if built else repair.origin,
        sdist_sha256=repair.origin if built else msgspec.UNSET,
        wheel_sha256=repair.wheel,
        build=tuple(repair.build),
    )


def _subject(record: CellRecord) -> SubjectEntry | None:
    subject, tested = record.cell.subject, record.subject
    if subject is None:
        return None
    return SubjectEntry(
        name=tested.name if tested else None,
        version=tested.version if tested else None,
        commit=subject.commit,
        changed=subject.changed,
        wheel_sha256=tested.sha256 if tested else None,
        extras=subject.extras,
        groups=subject.groups,
    )


def _suite(assessed: Assessed, locate: Locate) -> SuiteEntry | None:
    suite = assessed.suite
    if suite is None:
        return None
    facts: Mapping[str, Any] = next((check.facts for check in suite.checks), {})
    return SuiteEntry(
        outcome=suite.outcome,
        tests=dict(facts.get("tests", {})),
        failed=tuple(facts.get("failed", ())) or msgspec.UNSET,
        decisive=suite.decisive,
        evidence=locate(suite.evidence) if suite.evidence else None,
        diagnoses=tuple(map(diagnosis_entry, assessed.suite_diagnoses)) or msgspec.UNSET,
    )


def _case(case: AssessedCase, unverified: tuple[str, ...], locate: Locate) -> CaseEntry:
    checks = case.checks
    return CaseEntry(
        case=case.record.case,
        env=case.record.env,
        api=case.record.api,
        phases={phase.phase: phase.outcome for phase in case.reported_phases},
        checks={check.check: check.outcome for check in checks},
        frames=tuple(locate(frame) for phase in case.phases for frame in phase.frames),
        decisive=case.decisive,
        reasons={check.check: check.decisive for check in checks if check.decisive},
        masked={check.check: check.masked_by for check in checks if check.masked_by},
        evidence={
            phase.phase: locate(phase.evidence)
            for phase in case.phases
            if phase.evidence and phase.outcome not in WITHOUT_TEXTS
        },
        drawn=dict(case.drawn),
        told={check.check: measurements for check in checks if (measurements := check.facts.get("told"))}
        or msgspec.UNSET,
        misleads=case.misleads,
        unverified=unverified,
        exercised=case.packages or msgspec.UNSET,
    )


# --- reading, writing, moving ----------------------------------------------------------------------------------


def encode(document: Document) -> bytes:
    """Return the document as JSON, equal for equal documents, with a line for each combination."""
    parts = decoding.decoder(dict[str, msgspec.Raw]).decode(msgspec.json.encode(document, order="deterministic"))
    return b"{" + b",".join(_line(name, bytes(part)) for name, part in parts.items()) + b"\n}\n"


def _line(name: str, content: bytes) -> bytes:
    if content.startswith(b"["):
        items = decoding.decoder(tuple[msgspec.Raw, ...]).decode(content)
        content = b"[" + b",".join(b"\n " + bytes(item) for item in items) + b"]"
    return b"\n" + msgspec.json.encode(name) + b":" + content


def read(content: bytes, name: str) -> Document:
    """Read a document; `name` is the name of its file in messages. Unknown keys are ignored.

    Raises BadInput, also if a combination is listed twice: one of the two would be lost silently.
    """
    document = schema.load_json(content, Document, name)
    seen = Counter((cell.id, cell.machine) for cell in document.cells)
    twice = next((cell_id for (cell_id, _), number in seen.items() if number > 1), None)
    if twice is not None:
        message = f"{name}: cells: {twice} is listed twice for one machine"
        raise BadInput(message)
    return _renamed(document)


def read_file(path: Path) -> Document:
    """Read the document in a file. Raises BadInput."""
    return read(given_files.read_content(path), str(path))


def _renamed(document: Document) -> Document:
    """Return the document with ids in today's format: earlier versions wrote them without separators."""
    names = {}
    for cell in document.cells:
        names[cell.id] = cellid.to_current_form(cell.id, cell.axes, cell.requested_python if cell.base else None)
        if cell.base:
            names[cell.base] = cellid.to_current_form(cell.base, cell.axes)
    if all(old == new for old, new in names.items()):
        return document
    replaced = msgspec.structs.replace

    def renamed(cell: CellEntry) -> CellEntry:
        diagnoses = (replaced(one, proof=names.get(one.proof or "", one.proof)) for one in cell.diagnoses)
        return replaced(cell, id=names[cell.id], base=cell.base and names[cell.base], diagnoses=tuple(diagnoses))

    # A sentence about a cell begins with its id; one about the matrix file does not.
    stale = (text.partition(" ") for text in document.stale)
    return replaced(
        document,
        cells=tuple(map(renamed, document.cells)),
        dropped=tuple(replaced(gone, id=_left_out(gone.id, document)) for gone in document.dropped),
        stale=tuple(names.get(first, first) + space + rest for first, space, rest in stale),
    )


def _left_out(cell_id: str, document: Document) -> str:
    entry = document.matrices.get(CellId.parse(cell_id).matrix)
    if entry is None:
        return cell_id
    cells = [cell for cell in document.cells if cell.matrix == CellId.parse(cell_id).matrix]
    values = {axis: dict.fromkeys(cell.axes[axis] for cell in cells if axis in cell.axes) for axis in entry.axes}
    return cellid.newer_left_out(cell_id, values)


def relocate(document: Document, locate: Locate) -> Document:
    """Return the document with every path replaced by `locate(path)`; one that becomes empty is left out."""
    return msgspec.structs.replace(document, cells=tuple(relocate_cell(cell, locate) for cell in document.cells))


def relocate_cell(cell: CellEntry, locate: Locate) -> CellEntry:
    """Return a cell with every path replaced by `locate(path)`; one that becomes empty is left out."""

    def moved(path: str | None) -> str | None:
        return (locate(path) or None) if path else None

    def case(entry: CaseEntry) -> CaseEntry:
        evidence = {phase: new for phase, path in entry.evidence.items() if (new := locate(path))}
        return replace(entry, frames=tuple(filter(None, map(locate, entry.frames))), evidence=evidence)

    return replace(
        cell,
        lock=moved(cell.lock),
        evidence=moved(cell.evidence),
        suite=replace(cell.suite, evidence=moved(cell.suite.evidence)) if cell.suite else None,
        cases=tuple(map(case, cell.cases)),
    )


def paths(document: Document) -> frozenset[str]:
    """Return every file and folder that a document names."""
    names: set[str] = set()

    def keep(path: str) -> str:
        names.add(path)
        return path

    relocate(document, keep)
    return frozenset(names)


def combine(documents: Sequence[Document]) -> Document:
    """Merge several documents. If a cell was measured twice on one machine, the later result counts."""
    cells: dict[tuple[str, str | None], CellEntry] = {}
    for entry in (entry for document in documents for entry in document.cells):
        before = cells.get((entry.id, entry.machine))
        if before is None or (entry.measured or "") >= (before.measured or ""):
            cells[entry.id, entry.machine] = entry
    measured = {name for name, machine in cells if machine}
    return Document(
        generated=max(document.generated for document in documents),
        machines={name: facts for document in documents for name, facts in document.machines.items()},
        cells=change_effects.mark_proven(
            entry for entry in cells.values() if entry.machine or entry.id not in measured
        ),
        dropped=tuple({gone.id: gone for document in documents for gone in document.dropped}.values()),
        matrices={name: matrix for document in documents for name, matrix in document.matrices.items()},
        stale=tuple(dict.fromkeys(sentence for document in documents for sentence in document.stale)),
        probes={name: probe for document in documents for name, probe in document.probes.items()},
        boundaries=tuple(one for document in documents for one in document.boundaries or ()) or msgspec.UNSET,
        pictures=tuple(one for document in documents for one in document.pictures or ()) or msgspec.UNSET,
        consequences=tuple(one for document in documents for one in document.consequences or ()) or msgspec.UNSET,
    )


def only(document: Document, ids: Container[str]) -> Document:
    """Return the document with these cells alone."""
    return msgspec.structs.replace(document, cells=tuple(cell for cell in document.cells if cell.id in ids))


def exit_code(document: Document, fail_on: Iterable[str]) -> int:
    """Return the exit code for a document; 3 if nothing is wrong but a package's own tests could not be run."""
    judged = [(cell.verdict, cell.as_expected) for cell in document.cells]
    code = expectation.exit_code(judged, stale=bool(document.stale), fail_on=frozenset(fail_on))
    return code or (3 if any(cell.suite and cell.suite.not_run for cell in document.cells) else 0)

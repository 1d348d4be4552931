"""Regroup the report document into tables: plain data, ready to be presented in any form."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from harness.model import Outcome, Phase, Role, Verdict, replace
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.model.report_types import SEVERITY, UNTOLD, CaseEntry, CellEntry, Document, MatrixEntry, RepairEntry
from harness.model.vocabulary import settings as settings  # noqa: PLC0414 - others take it from here
from harness.reports.tables import cause_groups, family_tables, frame_rows, squares, suite_tables, verdict_reasons
from harness.reports.tables.squares import NOTHING
from harness.reports.tables.table_types import Remark, Report, Row, Sheet, Task
from harness.reports.text import platforms

TITLE = "what works together"
"""The heading of a matrix that names none."""

KINDS = {
    "deprecation": (".deprecation",),
    "packaging": ("install.", "import.written", ".compiled"),
    "reproducibility": (".repeat", "behave."),
    "API conformance": ("single.", "vector.", "interop."),
    "rendering": ("render.",),
    "other": ("",),
}
"""Sorts of findings, and what the names of their checks contain; the first that fits holds."""

ORDER = ("reproducibility", "API conformance", "rendering", "packaging", "deprecation", "other")
"""The sorts as a report lists them."""


def report(document: Document, pivot: tuple[str, str] | None = None) -> Report:
    """Return the tables of a report; `pivot` names the axes of the small table, down and across."""
    names = dict.fromkeys((*document.matrices, *(cell.matrix for cell in document.cells)))
    matrices = {name: document.matrices.get(name) or _guessed(document.cells, name) for name in names}
    check_pivot(pivot, [matrix.axes for matrix in matrices.values()])
    return Report(
        generated=document.generated,
        sheets=tuple(_sheet(document, name, matrix, pivot) for name, matrix in matrices.items()),
        machines=tuple((name, platforms.facts(facts)) for name, facts in sorted(document.machines.items())),
        stale=document.stale,
        **platforms.coverage(document),
    )


def check_pivot(pivot: Sequence[str] | None, axes: Sequence[Sequence[str]]) -> None:
    """Refuse two names that are not axes of one matrix; `axes` has those of each matrix. Raises BadInput."""
    if pivot and not any(set(pivot) <= set(names) for names in axes):
        valid_axes = sorted({name for names in axes for name in names})
        message = (
            f"--pivot {' '.join(pivot)}: takes two axes of one matrix; known here: {', '.join(valid_axes) or 'none'}"
        )
        raise BadInput(message)


def _guessed(cells: Iterable[CellEntry], name: str) -> MatrixEntry:
    """Return an entry for a matrix that the document does not describe: the axes are those of its cells."""
    return MatrixEntry(axes=tuple(dict.fromkeys(axis for cell in cells if cell.matrix == name for axis in cell.axes)))


def _sheet(document: Document, name: str, matrix: MatrixEntry, pivot: tuple[str, str] | None) -> Sheet:
    cells = [cell for cell in document.cells if cell.matrix == name]
    machines = tuple(sorted({cell.machine for cell in cells if cell.machine})) or (NOTHING,)
    columns = tuple(dict.fromkeys((*matrix.axes, *matrix.shown)))
    counts = Counter(cell.verdict for cell in cells)
    pivot_axes = pivot if pivot and set(pivot) <= set(matrix.axes) else matrix.pivot
    main = [cell for cell in cells if cell.role is Role.MAIN]
    chosen = pivot_axes or squares.default_axes(matrix.axes, main)
    dropped = [gone for gone in document.dropped if CellId.parse(gone.id).matrix == name]
    ids = {role: dict.fromkeys(cell.id for cell in cells if cell.role is role) for role in Role}
    bad = {cell.id for cell in main if cell.verdict not in {*UNTOLD, Verdict.WORKS}}
    works = {cell.id for cell in main if cell.verdict is Verdict.WORKS} - bad
    doubted = {cell.id for cell in main if cell.doubts} & works
    boundaries = [one for one in document.boundaries or () if one.matrix == name]
    called, changed = family_tables.call_by_ids(main, boundaries)
    return Sheet(
        matrix=name,
        title=(matrix.title or TITLE).replace("{cells}", str(len(ids[Role.MAIN]))),
        cells=len({cell.id for cell in cells}),
        main=len(ids[Role.MAIN]),
        works=len(works - doubted),
        doubted=len(doubted),
        roles=tuple((role, len(ids[role])) for role in Role if role is not Role.MAIN and ids[role]),
        results=len(cells),
        machines=machines,
        counts=tuple((verdict, counts[verdict]) for verdict in reversed(SEVERITY) if counts[verdict]),
        pivot=squares.pivot(cells, chosen, machines) if chosen else None,
        columns=columns,
        rows=_rows(cells, columns, machines),
        troubles=cause_groups.troubles(cells, matrix.axes),
        findings=_findings(cells, matrix.axes),
        dropped=_dropped((gone.reason, gone.id, gone.count) for gone in dropped),
        left_out=sum(gone.count for gone in dropped),
        tasks=_tasks(main),
        suites=tuple(suite_tables.changes(main, matrix.axes)),
        attempts=tuple(verdict_reasons.attempts(cells)),
        families=family_tables.tables(called, matrix.axes, changed),
        behaviour=family_tables.changes(changed),
        pictures=tuple(one for one in document.pictures or () if one.matrix == name),
        consequences=family_tables.consequence_lines(one for one in document.consequences or () if one.matrix == name),
        drawing=_grouped((text, about, cell.id) for cell in cells for about, text in _drawing(cell)),
        frames=frame_rows.frame_rows(cells, matrix.axes),
        repairs=_grouped((_repaired(one), str(one.link), cell.id) for cell in cells for one in cell.repairs),
    )


def _tasks(cells: Iterable[CellEntry]) -> tuple[Task, ...]:
    """Return each environment with its phases, in how many cells it was tried, and in how many it passed."""
    untried = {None, Outcome.SKIPPED, Outcome.NOT_REACHED}
    seen: dict[tuple[str, str, str], list[CaseEntry]] = {}
    for case in (case for cell in cells for case in cell.cases):
        seen.setdefault((case.case, case.env or "", case.api), []).append(case)
    return tuple(
        Task(
            name=name,
            env=env,
            api=api,
            phases=tuple(phase for phase in Phase if any(case.phases.get(phase) not in untried for case in cases)),
            passed=sum(map(squares.has_passed, cases)),
            tried=sum(map(squares.was_tried, cases)),
        )
        for (name, env, api), cases in seen.items()
    )


def _drawing(cell: CellEntry) -> Iterator[tuple[str, str]]:
    """Yield the renderer of a cell with frames, and the variables that a user must set, each with its heading."""
    drawn = [case for case in cell.cases if case.frames]
    for words in dict.fromkeys(context(case) for case in drawn if case.drawn):
        yield "renderer", words
    yield from (("set", words) for words in (settings(cell.supplied, cell.installed or {}) if drawn else ()))


def context(case: CaseEntry) -> str:
    """Describe the renderer that drew the frames of a case."""
    return ", ".join(
        case.drawn[part] for part in ("api", "renderer", "vendor", "version", "device") if part in case.drawn
    )


def _rows(cells: Iterable[CellEntry], columns: Sequence[str], machines: Sequence[str]) -> tuple[Row, ...]:
    """Return a row for each result, red ones first; results that several machines share are one row."""
    rows = sorted((_row(cell, columns) for cell in cells), key=_urgency)
    if len(machines) == 1:
        return tuple(rows)
    alike: dict[Row, list[Row]] = {}
    for row in rows:
        alike.setdefault(replace(row, machine="", seconds=0.0), []).append(row)
    merged = []
    for row, equal_rows in alike.items():
        where = "every machine" if len(equal_rows) == len(machines) else ", ".join(one.machine for one in equal_rows)
        merged.append(replace(row, seconds=max(one.seconds for one in equal_rows), machine=where))
    return tuple(merged)


def _urgency(row: Row) -> int:
    """Return a sort key: unexpected results, other failures, results that say nothing of the packages, then green."""
    if row.as_expected is False:
        return 0
    return 3 if row.verdict is Verdict.WORKS else 2 if row.verdict in UNTOLD else 1


def _row(cell: CellEntry, columns: Sequence[str]) -> Row:
    passed, tried = squares.tasks([cell])
    return Row(
        id=cell.id,
        label=cell.label,
        verdict=cell.verdict,
        as_expected=cell.as_expected,
        phase=verdict_reasons.failed_in(cell),
        why=_why(cell),
        hidden_by=verdict_reasons.hidden_by(cell),
        expected="" if verdict_reasons.plain(cell) else verdict_reasons.expectation(cell),
        versions=tuple(_version(cell, column) for column in columns),
        findings=len(cell.findings),
        seconds=cell.seconds,
        machine=cell.machine or NOTHING,
        role=cell.role,
        passed=passed,
        tried=tried,
        suite=suite_tables.tests(cell),
        lock=cell.lock or "",
        frames=tuple((case.case, case.frames[0]) for case in cell.cases if case.frames),
        repaired=tuple(f"{repair.package} {repair.version}" for repair in cell.repairs),
        **verdict_reasons.describe_cause(cell),
    )


def _repaired(repair: RepairEntry) -> str:
    """Describe the changes made to a release, and the reason."""
    changes = ", ".join(f"`{edit.field}: {edit.old}` to `{edit.new}`" for edit in repair.edits)
    return f"{repair.package} {repair.version}, {changes}: {repair.reason}"


def _version(cell: CellEntry, column: str) -> str:
    """Return the installed version, else the version asked for."""
    if column == "python":
        return cell.python or cell.requested_python
    requested_version = cell.axes.get(column, cell.environment.get(column, NOTHING))
    return (cell.installed or {}).get(column, requested_version)


def _why(cell: CellEntry) -> str:
    """Return the decisive line, with its environment if there are others; of a working cell what is not verified."""
    if cell.unverified and cell.verdict is Verdict.WORKS:
        reasons = dict.fromkeys(case.decisive for case in cell.cases if case.decisive)
        return f"not verified: {', '.join(cell.unverified)}" + (f" ({'; '.join(reasons)})" if reasons else "")
    hit = [case for case in cell.cases if case.decisive and case.decisive == cell.decisive]
    if hit and len(hit) < len(cell.cases):
        # Several cases may run one environment; then only their ids tell them apart.
        distinct = len({case.env for case in hit}) == len(hit)
        return f"{', '.join((distinct and case.env) or case.case for case in hit)}: {cell.decisive}"
    return cell.decisive or ""


# --- what needs words ------------------------------------------------------------------------------------------


def _findings(cells: Sequence[CellEntry], axes: Sequence[str]) -> tuple[Remark, ...]:
    """Group equal findings and sort them: first by kind (reproducibility first), then those of most cells."""
    groups: dict[tuple[str, str, str], list[tuple[str, CellEntry]]] = {}
    for cell in cells:
        for finding in cell.findings:
            kind = next(kind for kind, marks in KINDS.items() if any(mark in finding.check for mark in marks))
            groups.setdefault((kind, finding.level, finding.text), []).append((finding.check, cell))
    remarks = [
        Remark(
            about=f"{', '.join(dict.fromkeys(check for check, _ in found))}; {level}",
            text=text,
            cells=tuple(dict.fromkeys(cell.label for _, cell in found)),
            where=cause_groups.name_cells([cell for _, cell in found], cells, axes),
            kind=kind,
        )
        for (kind, level, text), found in groups.items()
    ]
    return tuple(sorted(remarks, key=lambda remark: (ORDER.index(remark.kind), -len(remark.cells))))


def _dropped(gone: Iterable[tuple[str, str, int]]) -> tuple[Remark, ...]:
    """Group (reason, id or pattern, how many combinations) by reason, those of most combinations first."""
    groups: dict[str, list[tuple[str, int]]] = {}
    for reason, name, count in gone:
        groups.setdefault(reason, []).append((CellId.parse(name).label, count))
    remarks = [
        Remark(about="", text=reason, cells=tuple(name for name, _ in held), count=sum(count for _, count in held))
        for reason, held in groups.items()
    ]
    return tuple(sorted(remarks, key=lambda remark: -remark.count))


def _grouped(notes: Iterable[tuple[str, str, str]]) -> tuple[Remark, ...]:
    """Group (text, what it is about, cell id) by text and subject, those of most cells first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for text, about, cell_id in notes:
        groups.setdefault((about, text), []).append(CellId.parse(cell_id).label)
    remarks = [Remark(about=about, text=text, cells=tuple(dict.fromkeys(ids))) for (about, text), ids in groups.items()]
    return tuple(sorted(remarks, key=lambda remark: -len(remark.cells)))

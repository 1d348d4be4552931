"""Regroups the report document into tables: plain data, ready to be presented in any form."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from packaging.version import InvalidVersion, Version

from harness import changes
from harness.errors import BadInput
from harness.model import Verdict
from harness.reporttypes import (
    SEVERITY,
    Attempt,
    CaseEntry,
    Cause,
    CellEntry,
    DiagnosisEntry,
    Document,
    Effect,
    Explanation,
    MatrixEntry,
    Pivot,
    Remark,
    Report,
    Row,
    Sheet,
    Square,
    word,
)

NOTHING = "-"


def report(document: Document, pivot: tuple[str, str] | None = None) -> Report:
    """Everything that a presentation shows; `pivot` names the axes of the small table, down and across."""
    matrices = {name: document.matrices.get(name) or _guessed(document.cells, name) for name in _names(document)}
    check_pivot(pivot, [matrix.axes for matrix in matrices.values()])
    return Report(
        generated=document.generated,
        sheets=tuple(_sheet(document, name, matrix, pivot) for name, matrix in matrices.items()),
        machines=tuple((name, _facts(facts)) for name, facts in sorted(document.machines.items())),
        stale=document.stale,
    )


def check_pivot(pivot: Sequence[str] | None, axes: Sequence[Sequence[str]]) -> None:
    """Refuse two names that are not axes of one of the matrices; `axes` are those of each."""
    if pivot and not any(set(pivot) <= set(names) for names in axes):
        known = sorted({name for names in axes for name in names})
        message = f"--pivot {' '.join(pivot)}: takes two axes of one matrix; known here: {', '.join(known) or 'none'}"
        raise BadInput(message)


def _names(document: Document) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*document.matrices, *(cell.matrix for cell in document.cells))))


def _guessed(cells: Iterable[CellEntry], name: str) -> MatrixEntry:
    """The axes of a matrix that the document does not describe: those of its cells."""
    return MatrixEntry(axes=tuple(dict.fromkeys(axis for cell in cells if cell.matrix == name for axis in cell.axes)))


def _sheet(document: Document, name: str, matrix: MatrixEntry, pivot: tuple[str, str] | None) -> Sheet:
    cells = [cell for cell in document.cells if cell.matrix == name]
    machines = tuple(sorted({cell.machine for cell in cells if cell.machine})) or (NOTHING,)
    columns = tuple(dict.fromkeys((*matrix.axes, *matrix.shown)))
    counts = Counter(cell.verdict for cell in cells)
    asked = pivot if pivot and set(pivot) <= set(matrix.axes) else matrix.pivot
    chosen = asked or _default_axes(matrix.axes, cells)
    dropped = [(gone.reason, "", gone.id) for gone in document.dropped if gone.id.partition("/")[0] == name]
    found = [
        (finding.text, f"{finding.check}, {finding.level}", cell.id) for cell in cells for finding in cell.findings
    ]
    locks = [(cell.lock, "", cell.id) for cell in cells if cell.lock]
    return Sheet(
        matrix=name,
        cells=len({cell.id for cell in cells}),
        results=len(cells),
        machines=machines,
        counts=tuple((verdict, counts[verdict]) for verdict in reversed(SEVERITY) if counts[verdict]),
        pivot=_pivot([cell for cell in cells if cell.base is None], chosen, machines) if chosen else None,
        columns=columns,
        rows=_rows(cells, columns, machines),
        explanations=_explanations(cells),
        findings=_grouped(found),
        dropped=_grouped(dropped),
        left_out=sum(gone.count for gone in document.dropped if gone.id.partition("/")[0] == name),
        locks=_grouped(locks),
        attempts=tuple(_attempts(cells)),
        drawing=_grouped((text, about, cell.id) for cell in cells for about, text in _drawing(cell)),
        repairs=_grouped((_repaired(one), str(one["link"]), cell.id) for cell in cells for one in cell.repairs),
    )


SETTING = {
    "DISPLAY": None,
    "MUJOCO_GL": {"mujoco", "mujoco-py", "free-mujoco-py", "dm-control"},
    "PYOPENGL_PLATFORM": {"pyopengl"},
    "SDL_VIDEODRIVER": {"pygame", "pygame-ce"},
}
"""Variables that the harness supplies, and the packages of which one has to be there for it to matter; None for any."""


def _drawing(cell: CellEntry) -> Iterator[tuple[str, str]]:
    """Of a cell with frames: what drew them, and what a user has to set for them, too; each with what it is."""
    drawn = [case for case in cell.cases if case.frames]
    for words in dict.fromkeys(context(case) for case in drawn if case.drawn):
        yield "what drew", words
    yield from (("to be set", words) for words in (settings(cell.supplied, cell.installed or {}) if drawn else ()))


def settings(supplied: Mapping[str, str], installed: Iterable[str]) -> tuple[str, ...]:
    """What of the variables that the harness supplied matters to the packages that are there: `NAME=value` of each."""
    there = {*installed}
    return tuple(
        f"{name}={value}"
        for name, value in supplied.items()
        if (readers := SETTING.get(name)) is None or readers & there
    )


def context(case: CaseEntry) -> str:
    """What drew the frames of a case, in words."""
    return ", ".join(
        case.drawn[part] for part in ("api", "renderer", "vendor", "version", "device") if part in case.drawn
    )


def _rows(cells: Iterable[CellEntry], columns: Sequence[str], machines: Sequence[str]) -> tuple[Row, ...]:
    """A row for each result; what several machines found alike is one."""
    rows = [_row(cell, columns) for cell in cells]
    if len(machines) == 1:
        return tuple(rows)
    alike: dict[Row, list[Row]] = {}
    for row in rows:
        alike.setdefault(replace(row, machine="", seconds=0.0), []).append(row)
    return tuple(
        replace(
            row, seconds=max(one.seconds for one in found), machine=_named([one.machine for one in found], machines)
        )
        for row, found in alike.items()
    )


def _named(found: Sequence[str], machines: Sequence[str]) -> str:
    return "every machine" if len(found) == len(machines) else ", ".join(found)


def _row(cell: CellEntry, columns: Sequence[str]) -> Row:
    return Row(
        id=cell.id,
        label=_label(cell.id),
        verdict=cell.verdict,
        as_expected=cell.as_expected,
        phase=_phase(cell),
        why=_why(cell),
        hidden_by=_hidden_by(cell),
        expected="" if _plain(cell) else _expected(cell),
        versions=tuple(_version(cell, column) for column in columns),
        findings=len(cell.findings),
        seconds=cell.seconds,
        machine=cell.machine or NOTHING,
        repaired=tuple(f"{repair['package']} {repair['version']}" for repair in cell.repairs),
        **_told(cell),
    )


def _told(cell: CellEntry) -> dict[str, Any]:
    """The deepest cause of a failure that is known, and its remedy."""
    if not cell.diagnoses:
        return {}
    deepest = cell.diagnoses[0]
    proof = f" (proven by {_label(deepest.proof)})" if deepest.proof else ""
    remedy = "; ".join(changes.words(deepest.remedy)) + proof
    return {"cause": deepest.cause, "remedy": remedy, "proven": deepest.proven}


def _repaired(repair: Mapping[str, Any]) -> str:
    """What was changed of a release, and why."""
    changes = ", ".join(f"`{edit['field']}: {edit['from']}` to `{edit['to']}`" for edit in repair["edits"])
    return f"{repair['package']} {repair['version']}, {changes}: {repair['reason']}"


def _label(cell_id: str) -> str:
    return cell_id.partition("/")[2] or cell_id


def _version(cell: CellEntry, column: str) -> str:
    """What is installed, else what was asked for."""
    if column == "python":
        return cell.python or cell.requested_python
    asked = cell.axes.get(column, cell.environment.get(column, NOTHING))
    return (cell.installed or {}).get(column, asked)


def _phase(cell: CellEntry) -> str:
    """Where it failed; what is not to be had here failed nowhere."""
    return "" if cell.verdict is Verdict.UNAVAILABLE else cell.phase or ""


def _why(cell: CellEntry) -> str:
    """The decisive line, with the environment it came from where there are others; or what could not be shown."""
    if cell.unverified:
        reasons = dict.fromkeys(case.decisive for case in cell.cases if case.decisive)
        return f"not verified: {', '.join(cell.unverified)}" + (f" ({'; '.join(reasons)})" if reasons else "")
    hit = [case for case in cell.cases if case.decisive and case.decisive == cell.decisive]
    if hit and len(hit) < len(cell.cases):
        return f"{', '.join(case.env or case.case for case in hit)}: {cell.decisive}"
    return cell.decisive or ""


# --- the pivot -------------------------------------------------------------------------------------------------


def _default_axes(axes: Sequence[str], cells: Sequence[CellEntry]) -> tuple[str, str] | None:
    """The first two axes that vary, Python last, else one that does and any other; None where nothing varies."""
    varying = [axis for axis in axes if len({cell.axes.get(axis) for cell in cells}) > 1]
    if len(axes) < 2 or not varying:
        return None
    if len(varying) > 2 and "python" in varying:
        varying.remove("python")
    down = varying[0]
    return down, (varying[1:] or [axis for axis in axes if axis != down])[0]


def _pivot(cells: Sequence[CellEntry], axes: tuple[str, str], machines: Sequence[str]) -> Pivot:
    down, across = axes
    rows, columns = (in_order(cell.axes.get(axis, NOTHING) for cell in cells) for axis in axes)
    met: dict[tuple[str, str], list[CellEntry]] = {}
    for cell in cells:
        met.setdefault((cell.axes.get(down, NOTHING), cell.axes.get(across, NOTHING)), []).append(cell)
    squares = tuple(tuple(_square(met.get((row, column), ()), machines) for column in columns) for row in rows)
    return Pivot(down=down, across=across, rows=rows, columns=columns, squares=squares)


def in_order(values: Iterable[str]) -> tuple[str, ...]:
    """Versions by age, after what is none (`absent`) in the order it comes."""
    distinct = dict.fromkeys(values)
    return tuple(sorted(distinct, key=lambda value: (_parsed(value) is not None, _parsed(value) or Version("0"))))


def _parsed(text: str) -> Version | None:
    try:
        return Version(text)
    except InvalidVersion:
        return None


def _square(cells: Sequence[CellEntry], machines: Sequence[str]) -> tuple[Square, ...]:
    """One entry per machine; a cell without a result there was not run there."""
    if not cells:
        return ()
    known = {(cell.id, cell.machine or NOTHING): cell.verdict for cell in cells}
    ids = dict.fromkeys(cell.id for cell in cells)
    return tuple(_worst(one, [known.get((cell_id, one), Verdict.NOT_RUN) for cell_id in ids]) for one in machines)


def _worst(machine: str, verdicts: Sequence[Verdict]) -> Square:
    run = [verdict for verdict in verdicts if verdict is not Verdict.NOT_RUN]  # what was not run hides nothing
    worst = min(run or verdicts, key=SEVERITY.index)
    return Square(machine=machine, verdict=worst, count=verdicts.count(worst), total=len(verdicts))


# --- what needs words ------------------------------------------------------------------------------------------


def _plain(cell: CellEntry) -> bool:
    """Whether a cell needs no explanation: it is green or was not run, and nobody expected otherwise."""
    return cell.verdict in {Verdict.WORKS, Verdict.NOT_RUN} and cell.as_expected is not False


def _explanations(cells: Iterable[CellEntry]) -> tuple[Explanation, ...]:
    """One per reason, for every cell that needs one."""
    groups: dict[tuple[Any, ...], list[CellEntry]] = {}
    results: Counter[str] = Counter()
    locks: dict[str, str] = {}
    for cell in cells:
        results[cell.id] += 1
        locks[cell.id] = cell.lock or ""
        if not (_plain(cell) or (cell.change and cell.as_expected is not False)):
            link = cell.expectation.link or "" if cell.expectation else ""
            ids = tuple(one.signature for one in counting(cell))
            why = _phase(cell), cell.decisive or "", _hidden_by(cell), _expected(cell), link, ids
            groups.setdefault((cell.verdict, *why), []).append(cell)
    return tuple(
        Explanation(
            verdict=verdict,
            phase=phase,
            decisive=decisive,
            hidden_by=hidden,
            expected=expected,
            link=link,
            cells=_labels(found, results),
            causes=tuple(_causes(found, locks)),
        )
        for (verdict, phase, decisive, hidden, expected, link, _), found in groups.items()
    )


def counting(cell: CellEntry) -> tuple[DiagnosisEntry, ...]:
    """The known failures that count in a cell: of those that mask others none, unless there is nothing else."""
    return tuple(one for one in cell.diagnoses if not one.masks) or cell.diagnoses


def _causes(cells: Sequence[CellEntry], locks: Mapping[str, str]) -> Iterator[Cause]:
    """The known failures of cells that have the same."""
    for place, one in enumerate(counting(cells[0])):
        proofs = [proof for cell in cells if (proof := counting(cell)[place].proof)]
        yield Cause(
            signature=one.signature,
            cause=one.cause,
            remedy=changes.words(one.remedy),
            proofs=tuple((_label(proof), locks.get(proof, "")) for proof in dict.fromkeys(proofs)),
            references=one.references,
        )


def _attempts(cells: Sequence[CellEntry]) -> Iterator[Attempt]:
    """The changes that were tried, each with the cell that it was tried on, on the same machine."""
    known = {(cell.id, cell.machine): cell for cell in cells}
    for after in cells:
        if after.change is None or after.base is None or after.verdict is Verdict.NOT_RUN:
            continue
        before = known.get((after.base, after.machine))
        yield Attempt(
            cell=_label(after.base),
            before=_stands(before) if before else "not run",
            change=after.change.name,
            does=after.change.does,
            reason=after.change.reason,
            advice=after.change.advice,
            link=after.change.link or "",
            after=_stands(after),
            effect=changes.effect(before, after) if before else Effect.UNTOLD,
            lock=after.lock or "",
            machine=after.machine or NOTHING,
        )


def _stands(cell: CellEntry) -> str:
    """Where a cell stands: its verdict, the phase, and the line that says why."""
    where = f" in {_phase(cell)}" if _phase(cell) else ""
    line = f": {cell.decisive}" if cell.decisive and cell.verdict is not Verdict.WORKS else ""
    return f"{word(cell.verdict)}{where}{line}"


def _labels(cells: Iterable[CellEntry], results: Mapping[str, int]) -> tuple[str, ...]:
    """Each cell once; with the machines that found this, where others found something else."""
    machines: dict[str, list[str]] = {}
    for cell in cells:
        machines.setdefault(cell.id, []).append(cell.machine or NOTHING)
    return tuple(
        _label(cell_id) + ("" if len(found) == results[cell_id] else f" on {', '.join(found)}")
        for cell_id, found in machines.items()
    )


def _hidden_by(cell: CellEntry) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{mask} ({check})" for case in cell.cases for check, mask in case.masked.items()))


def _expected(cell: CellEntry) -> str:
    """The expectation in a sentence, with its reason."""
    expect = cell.expectation
    if cell.as_expected is None:
        return ""
    if expect is None:
        return "as expected" if cell.as_expected else "not expected"
    if cell.as_expected:
        return f"as expected: {expect.reason}"
    where = f" in {expect.phase}" if expect.phase else ""
    match = f" with a line like {expect.match!r}" if expect.match else ""
    match += f" by {expect.signature}" if expect.signature else ""
    return f"not as expected, which was {word(expect.verdict)}{where}{match}: {expect.reason}"


def _grouped(said: Iterable[tuple[str, str, str]]) -> tuple[Remark, ...]:
    """(text, what it is about, cell id), equal ones together, those of most cells first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for text, about, cell_id in said:
        groups.setdefault((about, text), []).append(_label(cell_id))
    remarks = [Remark(about=about, text=text, cells=tuple(dict.fromkeys(ids))) for (about, text), ids in groups.items()]
    return tuple(sorted(remarks, key=lambda remark: -len(remark.cells)))


def _facts(facts: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    """Facts of a machine as words; what is not known is left out."""
    told = {name.replace("_", " "): _words(fact) for name, fact in sorted(facts.items())}
    return tuple((name, words) for name, words in told.items() if words)


def _words(fact: Any) -> str:
    match fact:
        case None:
            return ""
        case {"missing": why}:
            return f"none ({why})"
        case dict():
            return ", ".join(str(value) for _, value in sorted(fact.items()))  # report.json keeps no other order
        case list() | tuple():
            return ", ".join(map(_words, fact))
        case _:
            return str(fact)

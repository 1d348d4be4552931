"""`simmatrix show CELL`: show everything known about one cell."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path

from harness.commands import find_cell, issuing, shipped_cell
from harness.judging.known_failures import select_counting
from harness.machine import store
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import Cell, CellRecord, Outcome, Plan, Verdict, cellid
from harness.model.errors import BadInput
from harness.model.report_types import (
    SYMBOLS,
    CaseEntry,
    CellEntry,
    DiagnosisEntry,
    Document,
    SubjectEntry,
    SuiteEntry,
    word,
)
from harness.reports import document, publishing
from harness.reports.tables import tables
from harness.running import open_matrix
from harness.running.signatures import shipped_signatures
from harness.standalone import wrapping
from harness.standalone.failures.remedies import in_words
from harness.standalone.output import print_json

HELP = (
    "Show everything known about one combination: versions, phases, checks, the line that shows why it failed, its log"
    " and its lock. Results that come with simmatrix are included."
)

TAIL = 15
"""Lines of the log that are shown."""
LABEL = re.compile(r" *\S+(?: \S+)?  +")
"""The begin of a line in two columns."""
INDENT = 4
WHOLE = ("  |", "  uv ", "  simmatrix ", "lock ", "key ", "evidence ", "  frame ")
"""Begins of lines that people copy."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `show`."""
    parser.add_argument("cell", metavar="CELL", help="id of a combination, or a glob that matches one: '*mujoco-3.3*'")
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--json", action="store_true", help="print a report of this combination as JSON on stdout, and nothing else"
    )
    parser.add_argument("--lock-out", type=Path, metavar="FILE",
                        help="write the lock, with the patched wheels that it needs next to it")  # fmt: skip
    form.add_argument(
        "--issue",
        action="store_true",
        help="print a failure as an issue for the package's maintainers, without private data",
    )


def main(args: argparse.Namespace) -> int:
    """Show the cell, once for each machine it was measured on."""
    opened = store.open_store()
    all_records = tuple(opened.cells())
    records = _find_records(all_records, args.cell)
    report = (
        _document(records, all_records, opened) if records else shipped_cell.load(_find_shipped(all_records, args.cell))
    )
    if args.lock_out:
        from harness.running import lock_files  # noqa: PLC0415 - start-up

        command = lock_files.write(args.lock_out, shipped_cell.lock_of(report.cells[0].id))
        print(f"lock: {args.lock_out}\ninstall: {command}", file=sys.stderr)
    if args.json:
        print_json(document.encode(report))
        return 0
    if not records and args.issue:
        print(shipped_cell.issue(report.cells[0].id), end="")
        return 0
    if not records:
        _show_shipped(report)
        return 0
    if args.issue:
        red = [(record, entry) for record, entry in zip(records, report.cells, strict=True) if issuing.is_red(entry)]
        record, entry = (red or list(zip(records, report.cells, strict=True)))[0]
        print(issuing.issue(record, entry, opened.load_machine(record.machine), opened.folder), end="")
        return 0
    for record, entry in zip(records, report.cells, strict=True):
        _print([*_lines(entry), *_next(record.cell, entry)])
    return 0


def _show_shipped(report: Document) -> None:
    """Print a cell that was measured elsewhere, or before."""
    for entry in report.cells:
        _print(_lines(entry))
        print("next")
        if entry.lock_sha256:
            print(f"  {shlex.join(['simmatrix', 'show', entry.id, '--lock-out', 'requirements.txt'])}")
        print(f"  {shlex.join(['simmatrix', 'run', entry.matrix, '-k', entry.label])}")


def _find_shipped(records: Sequence[CellRecord], pattern: str) -> str:
    """Return the id of the one cell that the reports at hand have of this name. Raises BadInput."""
    cell_id = find_cell.single("show", pattern, shipped_cell.ids(pattern))
    if cell_id:
        return cell_id
    all_ids = [record.cell.id for record in records] + shipped_cell.ids("*")
    near = get_close_matches(pattern, all_ids, n=1)
    hint = f"; did you mean {near[0]}?" if near else "; `simmatrix known` lists what was measured"
    message = f"show {pattern}: no combination of this name was measured{hint}"
    raise BadInput(message)


def _find_records(records: Sequence[CellRecord], pattern: str) -> list[CellRecord]:
    """Return the records of the one cell that an id, label or glob names, by machine; none if it was not run here."""
    ids = sorted({cell.id for cell in cellid.select(pattern, [record.cell for record in records])})
    cell_id = find_cell.single("show", pattern, ids)
    return sorted((record for record in records if record.cell.id == cell_id), key=lambda record: record.machine)


def _document(records: Sequence[CellRecord], all_records: Sequence[CellRecord], opened: Store) -> Document:
    """Return the records as a document, judged together with changed versions of the cell.

    Its paths start from the working folder.
    """
    cell = records[0].cell
    # A changed cell may prove the remedy of this one, so both are judged together.
    near = {cell.id, cell.base}
    together = [record for record in all_records if record.cell.id in near or record.cell.base == cell.id]
    cells = {record.cell.id: record.cell for record in together}
    planned = Plan(matrix=cell.matrix, cells=tuple(cells.values()), axes=tuple(cell.axes))
    machines = {record.machine: opened.load_machine(record.machine) for record in records}
    locate = publishing.seen_from_here(opened.folder)
    causes = shipped_signatures.load_knowledge(opened.folder)
    report = document.build(together, [planned], machines, store.now(), locate, knowledge=causes)
    return document.only(report, {cell.id})


# --- what is said ----------------------------------------------------------------------------------------------


def _print(lines: Iterable[str]) -> None:
    """Print lines, broken at the width of a terminal; the log, commands and paths stay whole."""
    columns = wrapping.width(sys.stdout)
    for line in lines:
        label = LABEL.match(line)
        indent = len(label[0]) if label else INDENT
        print("\n".join([line] if line.startswith(WHOLE) else wrapping.wrap(line, columns, indent)))


def _lines(cell: CellEntry) -> Iterator[str]:
    where = f" in {cell.phase}" if cell.phase and cell.verdict is not Verdict.UNAVAILABLE else ""
    yield f"{cell.id}"
    yield f"{SYMBOLS[cell.verdict]} {word(cell.verdict)}{where}"
    if cell.decisive:
        yield f"  {cell.decisive}"
    for name in cell.unverified:
        yield f"  not verified: {name}"
    yield from _expectation(cell)
    yield from _change(cell)
    for cell_diagnosis in select_counting(cell):
        yield from _diagnosis(cell_diagnosis)
    for suite_diagnosis in (cell.suite.diagnoses or ()) if cell.suite else ():
        yield from _diagnosis(suite_diagnosis)
    yield ""
    yield from _facts(cell)
    yield ""
    yield "phases"
    yield from (f"  {phase:<10} {word(outcome)}" for phase, outcome in cell.phases.items())
    for case in cell.cases:
        yield from _case(case)
    if cell.findings:
        yield "findings"
        yield from (f"  {found.level} {found.check}: {found.text}" for found in cell.findings)
    if cell.installed:
        yield "installed"
        yield from (f"  {name}=={version}" for name, version in sorted(cell.installed.items()))
    yield from _log(cell.evidence)


def _expectation(cell: CellEntry) -> Iterator[str]:
    if cell.expectation:
        fits = {True: "as expected", False: "not as expected", None: "expected"}[cell.as_expected]
        link = f" <{cell.expectation.link}>" if cell.expectation.link else ""
        yield f"  {fits} ({word(cell.expected)}): {cell.expectation.reason}{link}"


def _change(cell: CellEntry) -> Iterator[str]:
    if cell.change:
        link = f" <{cell.change.link}>" if cell.change.link else ""
        yield f"  {cell.base} with {cell.change.name}: {'; '.join(cell.change.does)}"
        yield f"  tried because: {cell.change.reason}{link}"


def _diagnosis(diagnosis: DiagnosisEntry) -> Iterator[str]:
    """Yield lines on a known failure: its cause, its remedy, whether the remedy is proven here, and references."""
    yield f"known as {diagnosis.signature}"
    yield f"  cause      {diagnosis.cause}"
    yield f"  seen       {diagnosis.seen}"
    yield f"  remedy     {in_words(diagnosis.remedy)}"
    yield f"  proven     {f'by {diagnosis.proof}, which works' if diagnosis.proof else 'not here'}"
    yield from (f"  reference  {reference}" for reference in diagnosis.references)


def _facts(cell: CellEntry) -> Iterator[str]:
    supplied = (f"{name}={value} (supplied)" for name, value in cell.supplied.items())
    rows = {
        "axes": ", ".join(f"{name} {value}" for name, value in cell.axes.items()),
        "asked for": ", ".join(cell.requirements),
        "subject": _subject(cell.subject) if cell.subject else None,
        "tests": _tests(cell.suite) if cell.suite else None,
        "python": cell.python or f"{cell.requested_python} (not there)",
        "variables": " ".join([*(f"{name}={value}" for name, value in cell.environment.items()), *supplied]),
        "machine": cell.machine,
        "measured": f"{cell.measured}, {cell.seconds:g} s" if cell.measured else None,
        "lock": cell.lock,
        "key": cell.key,
    }
    yield from (f"{name:<10} {value}" for name, value in rows.items() if value)


def _tests(suite: SuiteEntry) -> str:
    """Return the number of tests by outcome as text, or the reason why the suite could not be run."""
    if suite.not_run:
        return f"not run: {suite.decisive}"
    return ", ".join(f"{count} {how}" for how, count in suite.tests.items())


def _subject(subject: SubjectEntry) -> str:
    """Return the package under test as text: name, extras, version, groups, commit, and whether it was changed."""
    extras = f"[{','.join(subject.extras)}]" if subject.extras else ""
    groups = f" with {', '.join(subject.groups)}" if subject.groups else ""
    commit = f" at {subject.commit[:12]}" if subject.commit else ""
    changed = ", with changes that are not committed" if subject.changed else ""
    return f"{subject.name or 'not built'}{extras} {subject.version or ''}".rstrip() + groups + commit + changed


def _case(case: CaseEntry) -> Iterator[str]:
    yield f"case {case.case}" + (f" ({case.env}, {case.api})" if case.env else "")
    for check, outcome in case.checks.items():
        why = case.reasons.get(check)
        yield f"  {check:<18} {word(outcome)}" + (f": {why}" if why else "")
        if check in case.masked:
            yield f"  {'':<18} hid behind {case.masked[check]}"
    checked = {check.partition(".")[0] for check in case.checks}
    yield from (
        f"  {phase:<18} {word(outcome)}"
        for phase, outcome in case.phases.items()
        if phase not in checked and outcome is not Outcome.SKIPPED
    )
    yield from (f"  frame {frame}" for frame in case.frames)
    if case.drawn:
        yield f"  drawn by {tables.context(case)}"


def _log(evidence: str | None) -> Iterator[str]:
    """Yield the path of the evidence and the last lines of its log, which a folder holds as `log.txt`."""
    if evidence is None:
        return
    path = Path(evidence)
    file = path / "log.txt" if path.is_dir() else path
    yield f"evidence   {evidence}"
    if file.is_file():
        lines = file.read_text(encoding="utf-8", errors="replace").rstrip().splitlines()
        yield from (f"  | {line}" for line in lines[-TAIL:])


def _next(cell: Cell, entry: CellEntry) -> Iterator[str]:
    """Yield the commands that a reader may want to type next."""
    yield "next"
    if entry.lock and entry.verdict is Verdict.WORKS:
        yield f"  uv pip sync --require-hashes {shlex.quote(entry.lock)}"
        # A lock never holds the package under test itself.
        if cell.subject:
            yield f"  uv pip install --no-deps {shlex.quote(cell.subject.source)}"
    yield f"  {_again(cell)}"


def _again(cell: Cell) -> str:
    if cell.matrix != plan.TRY_MATRIX:
        files = [f"{cell.matrix}.toml", f"matrices/{cell.matrix}.toml"]
        near = next((file for file in files if Path(file).is_file()), files[0])
        name = cell.matrix if cell.matrix in open_matrix.built_in() else near
        return shlex.join(["simmatrix", "run", name, "-k", cell.label, "--fresh"])
    question = cell.question
    options = {
        "--python": [cell.python],
        "--env": dict.fromkeys(case.env for case in cell.cases if case.env),
        "--import": dict.fromkeys(module for case in cell.cases for module in case.imports),
        "--set": [f"{name}={value}" for name, value in cell.environment.items()],
        "--constraint": question.constraints,
        "--override": question.overrides,
        "--build-constraint": question.build_constraints,
        "--only-binary": question.only_binary,
    }
    words = [word for option, values in options.items() for value in values for word in (option, value)]
    return shlex.join(["simmatrix", "try", *question.requirements, *words, "--fresh"])

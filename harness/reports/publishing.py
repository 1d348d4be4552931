"""Publish the records of `run` and `try`: a report folder, a table on the terminal, an exit code."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path
from stat import S_ISDIR
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct

from harness.judging.runs.case import BULKY
from harness.judging.runs.check import phase_of
from harness.machine import store, this_machine
from harness.machine.files.file_locks import exclusive
from harness.machine.store import Store
from harness.model import CellRecord, Phase, Plan, replace
from harness.model.errors import CouldNotTell, HarnessError, in_the_way
from harness.model.report_types import Document, format_count
from harness.model.vocabulary import IMPORT_CHECK
from harness.probes import launch
from harness.probes.evidence import REPLY
from harness.probes.vault import Vault
from harness.reports import document, freshness, size_plot
from harness.reports.pictures import first_pictures
from harness.reports.tables import tables
from harness.reports.tables.table_types import Report
from harness.reports.template_files import read_template
from harness.reports.text import author_pages, report_markdown, terminal
from harness.running.signatures import shipped_signatures
from harness.standalone.failures.remedies import in_words
from harness.standalone.output import print_json
from harness.standalone.requirements import requirement

HEAD_BYTES, TAIL_BYTES, WORTH_LEAVING_OUT = 2_000, 6_000, 1_000
"""Bytes of the beginning and of the end of a log that a report shows, and the fewest between them that are left out."""


class Wanted(Struct, frozen=True, kw_only=True):
    """The user's options for the report; `alone` leaves out earlier measurements, as a shard does."""

    out: Path | None
    pivot: tuple[str, str] | None
    json: bool
    fail_on: tuple[str, ...]
    alone: bool = False

    @classmethod
    def of(cls, args: argparse.Namespace) -> Wanted:
        """Return the options from the command line of `run`."""
        pivot = tuple(args.pivot) if args.pivot else None
        alone = args.shard is not None
        return cls(out=args.out, pivot=pivot, json=args.json, fail_on=args.fail_on, alone=alone)


class PublishedReport(NamedTuple):
    """A report and its folder; `tables` is set if it was just made, `trouble` if it could not be written."""

    folder: Path
    document: Document
    tables: Report | None = None
    trouble: str | None = None


def publish(
    plans: Sequence[Plan], measured: Mapping[str, CellRecord], opened: Store, wanted: Wanted
) -> list[PublishedReport]:
    """Write the report of each matrix from new records (`measured`, by cell id), and earlier ones for other cells."""
    here = this_machine.facts()
    reports: list[PublishedReport] = []
    for plan in plans:
        folder = wanted.out or opened.folder / "reports"
        folder = folder if wanted.out and len(plans) == 1 else folder / plan.matrix
        with exclusive(opened.folder / "reports" / f"{plan.matrix}.lock"):  # the last of several runs sees all cells
            others = [] if wanted.alone else [cell for cell in plan.cells if cell.id not in measured]
            before = {cell.id: opened.load_current(here.id, cell) for cell in others}
            records = [record for cell in plan.cells if (record := measured.get(cell.id) or before.get(cell.id))]
            used, note = probes(plan), opened.folder / "reports" / f"{plan.matrix}.note"
            made_of = freshness.mark(plan, records, here, folder, (used, wanted.pivot))
            report, shown = freshness.read(note, made_of, folder), None
            if report is not None and (counted := freshness.count_reused(report, records)) is not report:
                report = None if wanted.out else _rewritten(counted, folder, note, made_of)
            if report is None:
                facts, causes = {here.id: here.facts}, shipped_signatures.load_knowledge(opened.folder)
                making = partial(document.build, records, [plan], facts, store.now(), probes=used, knowledge=causes)
                try:
                    report = making(locate=place(records, opened, folder))
                    report = _compared(report, records, plan, Vault(opened.folder))
                    shown = write(report, folder, wanted.pivot, plan.page)
                    # A report in the state folder needs no pack, because its evidence lies in the same folder.
                    if wanted.out:
                        pack(report, plan, records, opened, folder)
                    # The note comes last: it must not speak for a report that was written in part.
                    freshness.keep(note, made_of, folder)
                except OSError as error:  # a full disk loses nobody the table of what was measured
                    trouble = in_the_way(error)
                    if trouble is None:
                        raise
                    report = making(locate=seen_from(folder, opened.folder))
                    reports.append(PublishedReport(folder, report, tables.report(report, wanted.pivot), trouble))
                    continue
        reports.append(PublishedReport(folder, report, shown))
    return reports


def _rewritten(report: Document, folder: Path, note: Path, made_of: str) -> Document | None:
    """Write only the JSON of a report whose tables stay as they are; return None if it cannot be written."""
    try:
        store.write_atomic(folder / "report.json", document.encode(report))
        freshness.keep(note, made_of, folder)
    except OSError:
        return None
    return report


def _compared(report: Document, records: Sequence[CellRecord], plan: Plan, vault: Vault) -> Document:
    """Return the document with what its cells show beside each other: behaviour and pictures. Most have neither."""
    if _behaves(plan):
        from harness.reports import behaviour  # noqa: PLC0415 - start-up

        report = behaviour.add(report, records, [plan], vault)
    if first_pictures.may_differ(records, vault):
        from harness.reports.pictures import boundaries  # noqa: PLC0415 - start-up

        report = boundaries.add(report, records, [plan], vault)
    return report


def _behaves(plan: Plan) -> bool:
    """Return whether a case of the plan asks for checks of behaviour."""
    return any(phase_of(check) is Phase.BEHAVE for cell in plan.cells for case in cell.cases for check in case.checks)


def load(plans: Iterable[Plan]) -> None:
    """Get ready for `publish` and `finish` of a report that is made again: imports, the template, the parser."""
    import rich.console  # noqa: F401, PLC0415 - start-up

    requirement("gymnasium")
    page(Report(generated="", sheets=(), machines=(), stale=()))
    if any(map(_behaves, plans)):
        from harness.reports import behaviour  # noqa: F401, PLC0415 - start-up


def pack(report: Document, plan: Plan, records: Iterable[CellRecord], opened: Store, folder: Path) -> None:
    """Store the evidence of a report beside it, so that it can be judged again without this state folder."""
    from harness.reports import packs  # noqa: PLC0415 - start-up

    packed = packs.Packed(
        plans=(replace(plan, banks={}),), machines=report.machines, probes=dict(report.probes), records=tuple(records)
    )
    hashes = packs.write(packed, opened.folder, folder)
    sha = packs.sha256(document.encode(report))
    packs.write_index(folder, packs.Index(judged=report.generated, report=sha, packs=hashes))


def finish(plans: Sequence[Plan], records: Iterable[CellRecord], opened: Store, wanted: Wanted) -> int:
    """Write the report of each matrix, print the table, and return the exit code of all."""
    measured = {record.cell.id: record for record in records}
    reports = publish(plans, measured, opened, wanted)
    whole = document.combine([one.document for one in reports])
    if wanted.json:
        here_now = [document.relocate(one.document, seen_from_here(one.folder)) for one in reports]
        print_json(document.encode(document.combine(here_now)))
    else:
        shown = reports[0].tables if len(reports) == 1 else None
        terminal.show(shown or tables.report(whole, wanted.pivot))
        print(_closing(list(measured.values())))
        for report in reports:
            if report.trouble is None:
                print(f"report: {os.path.relpath(report.folder)}")
            for line in _suites_not_run(report.document):
                print(line)
    # A shard answers for its own cells only: those of the other shards are `not_run` in its report.
    code = document.exit_code(document.only(whole, measured) if wanted.alone else whole, wanted.fail_on)
    troubles = [one.trouble for one in reports if one.trouble]
    for trouble in troubles:
        print(
            f"simmatrix: the report is not written: {trouble}; fix that and run the same command again", file=sys.stderr
        )
    return code or (CouldNotTell.exit_code if troubles else 0)


def _suites_not_run(report: Document) -> Iterator[str]:
    """Yield the reasons why tests could not be run, each once, with the known cause and its remedy."""
    suites = [cell.suite for cell in report.cells if cell.suite and cell.suite.not_run]
    for why, count in Counter(suite.decisive for suite in suites).items():
        first = next(suite for suite in suites if suite.decisive == why)
        yield f"tests not run in {format_count(count, 'cell')}, where the verdict is that of the cases alone: {why}"
        for diagnosis in (first.diagnoses or ())[:1]:
            yield f"  cause: {diagnosis.cause} (known as {diagnosis.signature})"
            yield f"  remedy: {in_words(diagnosis.remedy)}"


def place(records: Iterable[CellRecord], opened: Store, folder: Path) -> document.Locate:
    """Copy the files that records name into a report's folder; return the function that names them from there."""
    return _Files(opened, folder).place(records)


def probes(plan: Plan) -> dict[str, str]:
    """Return the hash of the in-cell files that the cases of a plan run, by API and phase."""
    used = {(case.api, phase_of(check)) for cell in plan.cells for case in cell.cases for check in case.checks}
    return {f"{api or 'none'}.{phase}": launch.probe_hash(api, phase) for api, phase in sorted(used)}


def write(report: Document, folder: Path, pivot: tuple[str, str] | None, words: str | None = None) -> Report:
    """Write `report.json`, `report.md` and plots of behaviour into a folder, and return the tables of the report.

    Files that only the last report named are deleted. `words` is the template of the page in words, `README.md`, if the
    matrix has one.
    """
    # The sweep reads the report.json of the last time, so it comes before that file is overwritten.
    _sweep(folder, document.paths(report))
    store.write_atomic(folder / "report.json", document.encode(report))
    shown = tables.report(report, pivot)
    store.write_atomic(folder / "report.md", page(shown).encode())
    for table in (table for sheet in shown.sheets for table in sheet.families):
        store.write_atomic(folder / table.picture, size_plot.draw(table))
    if words is not None:
        store.write_atomic(folder / freshness.WORDS, author_pages.render(words, report, shown).encode())
    return shown


def _sweep(folder: Path, named: frozenset[str]) -> None:
    try:
        before = document.read_file(folder / "report.json")
    except HarnessError:  # none was written before, or it was damaged
        return
    places = ((folder / name).resolve() for name in document.paths(before) - named)
    for path in (place for place in places if folder.resolve() in place.parents):  # a report may name anything
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def page(report: Report) -> str:
    """Return the report as Markdown."""
    return report_markdown.markdown(report, read_template(report_markdown.TEMPLATE))


@dataclass(slots=True)
class _Files:
    """The locks, frames and logs of a report, copied beside it."""

    opened: Store
    folder: Path
    placed: dict[str, str] = field(default_factory=dict)
    there: set[str] = field(default_factory=set)  # names that were copied: of equal frames the first

    def place(self, records: Iterable[CellRecord]) -> document.Locate:
        """Copy the frames, equal ones once, and return `locate`, which copies any other file when it is named."""
        for record in records:
            for case in record.cases:
                for frame in (frame for phase in case.phases for frame in phase.frames):
                    self._copy(frame, self._picture(case.case, frame))
        return self.locate

    def locate(self, path: str) -> str:
        """Return the path by which the report names a file of the store; copy the file if it is not there."""
        self._copy(path, path)
        return self.placed.get(path) or os.path.relpath(self.opened.folder / path, self.folder)

    def _picture(self, case: str, frame: str) -> str | None:
        source = self.opened.folder / frame
        if not source.is_file():
            return None
        return f"frames/{case}--{source.stem}--{sha256(source.read_bytes()).hexdigest()[:8]}.png"

    def _copy(self, path: str | None, name: str | None) -> None:
        if path is None or name is None or path in self.placed:
            return
        if name in self.there or copy_file(f"{self.opened.folder}/{path}", f"{self.folder}/{name}"):
            self.there.add(name)
            self.placed[path] = name


def copy_file(source: str | Path, target: str | Path, *, evidence: bool = False) -> bool:
    """Copy a file, or the text files of a folder of evidence; return False if there is nothing to copy."""
    try:
        there = os.stat(source)  # noqa: PTH116 - thousands of files
    except OSError:
        return False
    if S_ISDIR(there.st_mode):
        with os.scandir(source) as entries:
            # Pictures stay out: a report names each frame by itself.
            texts = sorted(entry.name for entry in entries if entry.name.endswith((".jsonl", ".log", ".txt")))
        # A list and not any(), which would stop after the first file that was copied.
        return bool([copy_file(f"{source}/{text}", f"{target}/{text}", evidence=True) for text in texts])
    if not _same(there, target):
        content = Path(source).read_bytes()
        if evidence:
            content = readable(content) if Path(source).name == REPLY else excerpt(content)
        store.write_atomic(Path(target), content)
        os.utime(target, ns=(there.st_atime_ns, there.st_mtime_ns))  # by which the next report knows it
    return True


def excerpt(content: bytes) -> bytes:
    """Return a text, a long one without its middle; it is whole in the pack, and in the state folder."""
    left_out = len(content) - HEAD_BYTES - TAIL_BYTES
    if left_out < WORTH_LEAVING_OUT:
        return content
    head, tail = content[:HEAD_BYTES], content[-TAIL_BYTES:]
    return b"\n".join((head, f"[... {left_out} bytes left out here ...]".encode(), tail))


def readable(reply: bytes) -> bytes:
    """Return the lines of a reply that say what was imported, what failed and what was noticed.

    All else is in the pack: checks that passed, the files of the harness that ran, and long lists of numbers.
    """
    return b"".join(map(_short, reply.splitlines(keepends=True)))


def _short(line: bytes) -> bytes:
    try:
        record = msgspec.json.decode(line)
        if record["kind"] == "start" or (record["kind"] == "check" and _went_well(record)):
            return b""
        if record["kind"] == "end":
            return msgspec.json.encode({name: fact for name, fact in record.items() if name != "modules"}) + b"\n"
        facts = {name: fact for name, fact in record["facts"].items() if name not in BULKY}
    except (msgspec.DecodeError, TypeError, LookupError, AttributeError):  # a cell may have written anything
        return line
    return line if facts == record["facts"] else msgspec.json.encode({**record, "facts": facts}) + b"\n"


def _went_well(record: dict[str, Any]) -> bool:
    return record["outcome"] in document.WITHOUT_TEXTS and record["check"] != IMPORT_CHECK


def _same(there: os.stat_result, target: str | Path) -> bool:
    """Return whether the target is the same file or a copy of it, which has its time."""
    try:
        here = os.stat(target)  # noqa: PTH116 - thousands of files
    except OSError:
        return False
    return here.st_mtime_ns == there.st_mtime_ns or (here.st_ino, here.st_dev) == (there.st_ino, there.st_dev)


def seen_from(folder: Path, state: Path) -> document.Locate:
    """Return the function that names files of the state relative to a report's folder."""
    return lambda path: os.path.relpath(state / path, folder)


def seen_from_here(folder: Path) -> document.Locate:
    """Return the function that turns paths relative to a folder into paths relative to the working folder."""
    return lambda path: os.path.relpath(folder / path)


def _closing(records: Sequence[CellRecord]) -> str:
    if not records:
        return "nothing was measured"
    reused = sum(record.reused for record in records)
    if reused == len(records):
        return f"nothing to do: all {reused} results are reused"
    return f"{format_count(len(records) - reused, 'combination')} measured, {reused} reused"

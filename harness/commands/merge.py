"""`simmatrix merge DIR...`: merge the reports of shards and machines into one."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from harness.commands import arguments
from harness.machine import store
from harness.model import Verdict
from harness.model.errors import BadInput
from harness.model.report_types import Document, format_count
from harness.reports import document, merging, publishing
from harness.reports.tables import tables
from harness.reports.text import terminal
from harness.standalone.output import print_json

HELP = (
    "Merge the reports of shards and machines into one report. The order does not matter, and a report may be named"
    " twice. Combinations that no shard measured are `not_run`."
)

NAME = "report.json"
DEEPEST = 6
"""Folders below a named one in which reports are looked for."""

CARRIED = frozenset({"locks", "frames", "evidence"})
"""The folders beside a report; a file anywhere else is none of its own."""

TEXTS = frozenset({".jsonl", ".log", ".txt"})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `merge`."""
    parser.add_argument(
        "sources",
        metavar="DIR",
        nargs="+",
        help="a folder that `simmatrix run --out` wrote, or a folder of such folders",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write the report to this folder (default: .harness/merged)"
    )
    parser.add_argument(
        "--format",
        choices=("terminal", "md", "json"),
        default="terminal",
        metavar="FORMAT",
        help="print the report as terminal, md or json (default: terminal)",
    )
    parser.add_argument("--pivot", nargs=2, metavar="AXIS", help="the two axes of the table: rows, columns")
    arguments.fail_on(parser)
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Write the merged report and print a summary; the exit code is that of `run`."""
    folder = args.out or store.state_folder() / "merged"
    reports = _find_reports(args.sources, folder)
    files = _Files()
    # All reports are read and checked before the first file is written.
    whole = merging.merge([files.read_report(path) for path in reports])
    pivot = tuple(args.pivot) if args.pivot else None
    tables.check_pivot(pivot, [matrix.axes for matrix in whole.matrices.values()])
    whole, copies = merging.assign_paths(whole)
    files.copy(copies, store.writable(folder))
    publishing.write(whole, folder, pivot)
    _print("json" if args.json else args.format, whole, folder, pivot)
    _tell(whole, len(reports), files.missing)
    stream = sys.stdout if args.format == "terminal" and not args.json else sys.stderr
    print(f"report: {os.path.relpath(folder)}", file=stream)
    return document.exit_code(whole, args.fail_on)


def _print(form: str, whole: Document, folder: Path, pivot: tuple[str, str] | None) -> None:
    match form:
        case "terminal":
            terminal.show_summary(tables.report(whole, pivot))
        case "md":
            sys.stdout.write(publishing.page(tables.report(whole, pivot)))
        case _:
            print_json(document.encode(document.relocate(whole, publishing.seen_from_here(folder))))


def _tell(whole: Document, reports: int, missing: int) -> None:
    gaps = sum(cell.verdict is Verdict.NOT_RUN for cell in whole.cells)
    summary = (
        f"{format_count(reports, 'report')} merged: {format_count(len({cell.id for cell in whole.cells}), 'cell')}"
    )
    machines = f" on {format_count(len(whole.machines), 'machine')}" if len(whole.machines) > 1 else ""
    print(f"{summary}{machines}, {gaps or 'none'} not run", file=sys.stderr)
    if missing:
        print(
            f"{format_count(missing, 'file')} that the reports name are missing, and were left out",
            file=sys.stderr,
        )


# --- where reports are -----------------------------------------------------------------------------------------


def _find_reports(names: Sequence[str], out: Path) -> list[Path]:
    """Return every report in these places once. An earlier output of this command counts only if it is named itself."""
    written = (out / NAME).resolve()
    reports: dict[Path, Path] = {}
    for name in names:
        place = Path(name)
        whole = {place, place / NAME}
        matches = [place] if place.is_file() else list(_below(place))
        if not matches:
            message = f"{name}: no {NAME} in this folder or below it; `simmatrix run MATRIX --out DIR` writes one"
            raise BadInput(message)
        reports |= {path.resolve(): path for path in matches if path in whole or path.resolve() != written}
    return list(reports.values())


def _below(folder: Path) -> Iterator[Path]:
    """Yield the reports below a folder. Folders inside that of a report are not searched."""
    for place, folders, names in os.walk(folder):
        if NAME in names:
            yield Path(place, NAME)
        folders.sort()
        if NAME in names or len(Path(place).relative_to(folder).parts) >= DEEPEST:
            folders.clear()


# --- what lies beside them -------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Files:
    """The files that reports name, by content. Reports may come from anywhere: only their own folders are read."""

    places: dict[str, Path] = field(default_factory=dict)
    missing: int = 0

    def read_report(self, path: Path) -> merging.Source:
        """Read a report, and replace the name of each file by a token of its path and content."""
        report = document.read_file(path)
        tokens = {name: self._token(path.parent, name) for name in sorted(document.paths(report))}
        self.missing += sum(not token for token in tokens.values())
        return merging.Source(name=str(path), document=document.relocate(report, tokens.__getitem__))

    def _token(self, folder: Path, name: str) -> str:
        path = PurePosixPath(name)
        # A report may come from anybody's pull request and name any path.
        if path.is_absolute() or ".." in path.parts or len(path.parts) < 2 or path.parts[0] not in CARRIED:
            return ""
        try:
            files = dict(_inside(folder, folder / path))
        except OSError:  # no name that a file could have, or a file that cannot be read
            files = {}
        if not files:
            return ""
        content = hashlib.sha256()
        for inner, file in sorted(files.items()):
            content.update(inner.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
        token = merging.token(str(path), content.hexdigest())
        self.places[token] = folder / path
        return token

    def copy(self, names: dict[str, str], folder: Path) -> None:
        """Copy files, given by their tokens, to names below a folder. Raises BadInput if a name leads out of it."""
        for token, name in names.items():
            source, target = self.places[token], folder / name
            if not target.resolve().is_relative_to(folder.resolve()):
                message = f"{target} leads out of {folder}; name another folder with --out"
                raise BadInput(message)
            if source.resolve() != target.resolve():
                publishing.copy_file(source, target)


def _inside(folder: Path, path: Path) -> Iterator[tuple[str, Path]]:
    """Yield a file, or the texts of a folder, with their names in it. Links and files outside a report are skipped."""
    candidates = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in candidates:
        plain = file.is_file() and not file.is_symlink() and file.resolve().is_relative_to(folder.resolve())
        if plain and (file is path or file.suffix in TEXTS):
            yield file.relative_to(path).as_posix(), file

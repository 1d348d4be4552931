"""`simmatrix report [SOURCE...]`: make tables from stored results."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from harness.commands import arguments
from harness.machine import store
from harness.model.errors import BadInput
from harness.model.report_types import Document
from harness.model.schema import suggestion
from harness.reports import document, judge_again, packs, publishing, readme_blocks
from harness.reports.answers import shipped_reports
from harness.reports.tables import tables
from harness.reports.tables.table_types import Pivot, Report, Sheet
from harness.reports.text import family_markdown, github_annotations, report_markdown, terminal
from harness.standalone.output import print_json

HELP = (
    "Print or write the tables of stored results: of a report.json, of a folder that holds one, or of a matrix that was"
    " measured here or comes with simmatrix. Of more than eight a terminal shows the counts alone. Nothing is measured."
)

FORMATS = ("terminal", "md", "json", "table", "github", "github-summary")
NAME = "report.json"
MOST_IN_FULL = 8
"""Reports that a terminal shows in full; of more it shows the counts."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `report`."""
    parser.add_argument(
        "sources",
        metavar="SOURCE",
        nargs="*",
        help="a report.json, its folder, or a matrix (default: every matrix measured here)",
    )
    parser.add_argument("--format", type=_formats, default=None, metavar="KINDS",
                        help=f"print these formats: {', '.join(FORMATS)}; separate with commas (default: terminal;"
                             " with --out: md,json)")  # fmt: skip
    parser.add_argument("--pivot", nargs=2, metavar="AXIS", help="the two axes of the table: rows, columns")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write report.md and report.json into this folder")
    parser.add_argument("--into", type=Path, metavar="FILE", help="update the tables inside this Markdown file")
    parser.add_argument("--judge-again", action="store_true",
                        help="judge reports again, from the stored evidence next to them and the current list of"
                             " known issues; print what changes")  # fmt: skip
    parser.add_argument("--write", action="store_true",
                        help="with --judge-again: write the changed reports")  # fmt: skip
    arguments.fail_on(parser)
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Print or write tables of stored results. Return the exit code that `run` would."""
    if args.into:
        return readme_blocks.renew(args.into, render_block)
    if args.judge_again:
        return _judged_again(args)
    if args.write:
        message = "--write needs --judge-again, and writes the changed reports"
        raise BadInput(message)
    sources = [locate(name) for name in args.sources] or _all()
    if args.out:
        store.writable(args.out)
    whole = _read(sources, args.out)
    report = tables.report(whole, tuple(args.pivot) if args.pivot else None)
    for form in ["json"] if args.json else args.format or (["md", "json"] if args.out else ["terminal"]):
        if args.out and form in {"md", "json"}:
            _write(form, whole, report, args.out)
        elif form == "github":
            sys.stdout.write(github_annotations.github(whole, args.fail_on))
        else:
            _print(form, whole, report, None if args.out else sources)
    return document.exit_code(whole, args.fail_on)


def _formats(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [name for name in names if name not in FORMATS]
    if unknown or not names:
        message = f"{text!r}: choose from {', '.join(FORMATS)}"
        raise argparse.ArgumentTypeError(message)
    return names


# --- where reports are -----------------------------------------------------------------------------------------


def _all() -> list[Path]:
    reports = sorted((store.state_folder() / "reports").glob(f"*/{NAME}"))
    if not reports:
        message = "nothing was measured here yet; run `simmatrix run quickstart`, or name a report.json"
        raise BadInput(message)
    return reports


def _judged_again(args: argparse.Namespace) -> int:
    if not args.sources or args.out:
        message = "--judge-again needs the folders of reports, such as reports/quickstart"
        raise BadInput(message)
    return judge_again.main([_folder(name) for name in args.sources], write=args.write, as_json=args.json)


def _folder(name: str) -> Path:
    """Return the folder of a report. Its report.json may be missing if the index of its evidence is there."""
    return Path(name) if (Path(name) / packs.INDEX).is_file() else locate(name).parent


def locate(name: str) -> Path:
    """Return the report.json that a path or the name of a matrix stands for. Raises BadInput if there is none."""
    reports = store.state_path() / "reports"
    if name.endswith(".toml"):
        name = Path(name).stem
    places = (Path(name), Path(name) / NAME, reports / name / NAME)
    report_path = next((place for place in places if place.is_file()), None)
    if report_path:
        return report_path
    shipped = shipped_reports.path(name)
    if shipped:
        return shipped
    names = [*(path.parent.name for path in reports.glob(f"*/{NAME}")), *shipped_reports.names()]
    message = f"{name}: no report.json here, and no matrix of this name was measured{suggestion(name, names)}"
    raise BadInput(message)


def _read(sources: Sequence[Path], out: Path | None) -> Document:
    """Read reports and combine them into one. A single one keeps its paths, so its page stays the same to the byte."""
    documents = [document.read_file(source) for source in sources]
    if len(sources) == 1:
        return document.relocate(documents[0], _carried(sources[0].parent, out)) if out else documents[0]
    moved = [_moved(made, source, out or Path()) for made, source in zip(documents, sources, strict=True)]
    return document.combine(moved)


def _moved(source_report: Document, source: Path, target: Path) -> Document:
    return document.relocate(source_report, lambda path: os.path.relpath(source.parent / path, target))


def _carried(folder: Path, out: Path) -> document.Locate:
    """Return a function that copies a file of a report into another folder, and returns its path there."""

    def carried(path: str) -> str:
        if ".." in Path(path).parts:
            return os.path.relpath(folder / path, out)
        publishing.copy_file(folder / path, out / path)
        return path

    return carried


# --- what is made of them --------------------------------------------------------------------------------------


def _write(form: str, whole: Document, report: Report, out: Path) -> None:
    name = f"report.{form}"
    content = document.encode(whole) if form == "json" else publishing.page(report).encode()
    store.write_atomic(out / name, content)
    print(f"report: {out / name}", file=sys.stderr)


def _tables(report: Report) -> str:
    """Return, as Markdown, the place and time of the measurements, then the small tables, each below its legend."""
    captioned = [text for sheet in report.sheets for text in _captioned(sheet)]
    return "\n".join([f"{report_markdown.coverage(report)}\n", *captioned])


def _captioned(sheet: Sheet) -> Iterator[str]:
    """Yield the tables of a matrix: of families where its behaviour was measured, else the small table."""
    for table in sheet.families:
        yield f"{family_markdown.family_legend(table)}\n\n{family_markdown.family_table(table)}"
    if sheet.pivot and not sheet.families:
        yield f"{_caption(sheet.pivot)}\n\n{report_markdown.small_table(sheet.pivot)}"


def _caption(pivot: Pivot) -> str:
    return f"Rows: {pivot.down}, columns: {pivot.across}. {report_markdown.legend(pivot)}"


def render_block(source: Path, pivot: tuple[str, str] | None) -> str:
    """Return the tables of a report, as Markdown for a block in a user's file."""
    return _tables(tables.report(_read([locate(str(source))], None), pivot))


def _print(form: str, whole: Document, report: Report, sources: Sequence[Path] | None) -> None:
    """Print one form; in JSON on stdout paths start from the working folder."""
    match form:
        case "terminal" if sources and len(sources) > MOST_IN_FULL:
            terminal.show_overview(report)
            print(f"\n{len(sources)} reports; one in full: simmatrix report MATRIX")
        case "terminal":
            terminal.show(report)
        case "md":
            sys.stdout.write(publishing.page(report))
        case "github-summary":
            sys.stdout.write(github_annotations.summary(publishing.page(report)))
        case "table":
            sys.stdout.write(_tables(report))
        case _:
            # Several reports were moved to the working folder when they were combined; a single one kept its paths.
            single = sources[0] if sources and len(sources) == 1 else None
            print_json(document.encode(_moved(whole, single, Path()) if single else whole))

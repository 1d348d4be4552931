"""`simmatrix known [PACKAGE | SIGNATURE]`: list measured packages and known issues, or open one of them."""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Iterator, Sequence
from difflib import get_close_matches

import msgspec
from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.judging import known_issues
from harness.judging.known_issues import Issue
from harness.model.errors import BadInput
from harness.model.report_types import format_count
from harness.model.vocabulary import required_name
from harness.reports.answers import measured_cells, result_index
from harness.reports.answers.measured_cells import CellResult
from harness.reports.answers.recommended_text import wrap_line
from harness.running.signatures import issue_texts
from harness.standalone.output import print_json

HELP = "List all measured packages and all known issues. With a name, show that package or that issue."


class PackageEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A package that was measured: releases, newest first, by whether some cell of them works as a whole."""

    name: str
    works: tuple[str, ...]
    others: tuple[str, ...]
    cells: int
    reports: tuple[str, ...]
    issues: tuple[str, ...]


class KnownDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `known --json`: packages that cases ran, and known issues."""

    schema: int = 1
    packages: tuple[PackageEntry, ...]
    issues: tuple[Issue, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `known`."""
    parser.add_argument(
        "name", metavar="PACKAGE|SIGNATURE", nargs="?", help="a package, or the id of a known issue (default: list all)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Print measured packages and known issues: all, or those of a name. An unknown name raises BadInput (exit 2)."""
    measured = result_index.load()
    issues = known_issues.with_cells(issue_texts.load(), measured.cells)
    answer = _answer(args.name, measured_cells.read(measured), issues)
    if args.json:
        print_json(msgspec.json.encode(answer))
        return 0
    width = shutil.get_terminal_size().columns
    print("\n".join(text for line in _lines(answer, args.name) for text in wrap_line(line, width)))
    return 0


def _answer(name: str | None, cells: Sequence[CellResult], issues: Sequence[Issue]) -> KnownDocument:
    """Return everything, or the package or the issue of a name. Raises BadInput."""
    # A package that only lay in a lock was never run, and so was not measured.
    packages = sorted({package for one in cells for package in one.exercised | (one.named & one.pins.keys())})
    if name is None:
        entries = tuple(_package(package, cells, issues) for package in packages)
        return KnownDocument(packages=entries, issues=tuple(issues))
    package = canonicalize_name(name)
    if package in packages:
        mine = [one for one in issues if package in _concerned(one)]
        entry = _package(package, cells, issues)
        return KnownDocument(packages=(entry,), issues=tuple(mine))
    issue = known_issues.lookup(name, issues)
    if issue:
        return KnownDocument(packages=(), issues=(issue,))
    near = get_close_matches(name.lower(), [*packages, *(one.id for one in issues)], n=3)
    hint = f"; did you mean {' or '.join(near)}?" if near else "; `simmatrix known` lists all"
    message = f"{name}: no package of this name was measured, and no known issue has this id{hint}"
    raise BadInput(message)


def _package(name: str, cells: Sequence[CellResult], issues: Sequence[Issue]) -> PackageEntry:
    mine = [one for one in cells if name in one.about and one.version(name)]
    works = {str(one.version(name)) for one in mine if one.works and name in one.exercised}
    others = {str(one.version(name)) for one in mine} - works
    return PackageEntry(
        name=name,
        works=tuple(sorted(works, key=Version, reverse=True)),
        others=tuple(sorted(others, key=Version, reverse=True)),
        cells=len(mine),
        reports=tuple(sorted({one.cell.matrix for one in mine})),
        issues=tuple(one.id for one in issues if name in _concerned(one)),
    )


def _concerned(issue: Issue) -> set[str]:
    """Return the packages that take part in a known issue."""
    return set(map(required_name, issue.packages))


def _lines(answer: KnownDocument, name: str | None) -> Iterator[str]:
    if name and not answer.packages:
        yield from known_issues.lines(answer.issues[0])
        return
    if name:
        yield from _of_package(answer.packages[0])
    else:
        yield f"{len(answer.packages)} packages were measured; `simmatrix known PACKAGE` shows one"
        yield from (
            f"  {one.name}  {_newest(one)}, {format_count(one.cells, 'combination')}" for one in answer.packages
        )
    yield ""
    yield f"{len(answer.issues)} known issues; `simmatrix known ID` shows one"
    yield from (
        f"  {one.id}{' (silent)' if one.silent else ''}: {textwrap.shorten(one.cause, 100)}" for one in answer.issues
    )


def _newest(package: PackageEntry) -> str:
    if not package.works:
        return f"{format_count(len(package.others), 'release')}, none works as a whole"
    return f"{format_count(len(package.works), 'release')} that work, up to {package.works[0]}"


def _of_package(package: PackageEntry) -> Iterator[str]:
    yield f"{package.name}: {format_count(package.cells, 'combination')}"
    yield f"  works      {', '.join(package.works) or 'no release as a whole'}"
    if package.others:
        yield f"  fails      {', '.join(package.others)}: no combination with these works as a whole"
    yield f"  reports    {', '.join(package.reports)}"
    yield from (f"  simmatrix report {report}" for report in package.reports)
    yield f"  simmatrix recommend {package.name}"

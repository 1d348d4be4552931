"""`simmatrix site [SOURCE...] --out DIR`: build a static site from reports."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec

from harness.commands.report import NAME, locate
from harness.model.report_types import format_count
from harness.standalone.output import print_json

HELP = (
    "Build a static site from reports: tables of what works together, and a page for every combination, package,"
    " environment and known issue. The site opens from disk and needs no network."
)


class SiteDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `site --json`: the folder, its first page, and the size of the site."""

    schema: int = 1
    out: str
    index: str
    pages: int
    cells: int
    files: int
    bytes: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `site`."""
    parser.add_argument("sources", metavar="SOURCE", nargs="*",
                        help="a report.json, a folder that holds one or several, or a matrix that was measured here"
                             " (default: the reports that come with simmatrix)")  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="DIR", required=True,
                        help="write the site to this folder; an earlier site in it is replaced")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Build the site. Return 0; bad input raises BadInput (exit 2), and nothing is written."""
    from harness.reports.site import build_site  # noqa: PLC0415 - start-up

    files = [file for name in args.sources for file in _files(name)]
    built = build_site.build(files, args.out)
    index = args.out / "index.html"
    if args.json:
        sizes = {"pages": built.pages, "cells": built.cells, "files": built.files, "bytes": built.bytes}
        print_json(msgspec.json.encode(SiteDocument(out=str(args.out), index=str(index), **sizes)))
        return 0
    size = f"{built.bytes / 1e6:.1f} MB"
    print(f"site: {format_count(built.pages, 'page')} on {format_count(built.cells, 'combination')}, {size}",
          file=sys.stderr)  # fmt: skip
    print(index)
    return 0


def _files(name: str) -> Iterator[Path]:
    """Yield the reports that a name stands for: one, or those in the folders of a folder. Raises BadInput."""
    folder = Path(name)
    inside = [] if (folder / NAME).is_file() else sorted(folder.glob(f"*/{NAME}"))
    yield from inside or [locate(name)]

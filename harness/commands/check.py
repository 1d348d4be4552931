"""`simmatrix check [-r FILE]`: check the packages of a project against measured results; nothing is installed."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec
from packaging.version import InvalidVersion, Version

from harness.commands import environment_at_hand
from harness.model.errors import BadInput, CouldNotTell
from harness.reports.answers import result_index
from harness.reports.projects import check_document, checked, checked_text, project, unknown_names
from harness.reports.projects.check_document import CheckedFiles
from harness.reports.projects.labelled_lines import wrap_labelled
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Check requirement files, or the active environment, against measured results: which versions work, which fail,"
    " which change the physics, and which were never measured. Nothing is installed."
)
MOST = 5
"""Findings of a kind that are shown."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `check`."""
    parser.add_argument("-r", "--requirements", dest="files", type=Path, metavar="FILE", nargs="+", action="extend",
                        help="requirements.txt, pyproject.toml, uv.lock, pylock.toml or environment.yml"
                             " (default: the active environment)")  # fmt: skip
    parser.add_argument(
        "--extra", metavar="NAME", action="append", default=[], help="an extra of the pyproject.toml; may be repeated"
    )
    parser.add_argument(
        "--group",
        metavar="NAME",
        action="append",
        default=[],
        help="a dependency group of the pyproject.toml; may be repeated",
    )
    parser.add_argument(
        "--python", metavar="V|PATH", help="with -r: the Python version; without: the environment to check"
    )
    parser.add_argument("--env", metavar="ID", help="only results of this environment, such as Ant-v5")
    parser.add_argument("--each", action="store_true", help="check each file separately, not all files together")
    parser.add_argument("--fail-on", type=_kinds, default=check_document.FAIL_ON, metavar="KINDS",
                        help="exit status 0 unless there is a finding of such a kind:"
                             f" {', '.join(check_document.FAIL_ON)}; separate with commas (default: all)")  # fmt: skip
    parser.add_argument("--all", action="store_true", help="show every finding")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def _kinds(text: str) -> tuple[str, ...]:
    kinds = tuple(name.strip() for name in text.split(",") if name.strip())
    unknown = [kind for kind in kinds if kind not in check_document.FAIL_ON]
    if unknown or not kinds:
        message = f"unknown kind {(unknown or [text])[0]!r}; choose from {', '.join(check_document.FAIL_ON)}"
        raise argparse.ArgumentTypeError(message)
    return kinds


def main(args: argparse.Namespace) -> int:
    """Check the project, print the findings, and return the exit code."""
    projects = [_read(args, files) for files in _files(args)]
    measured = result_index.load()
    unknown_names.refuse_environment(args.env, measured)
    documents = [checked.check(measured, each, args.env) for each in projects]
    if args.json:
        print_json(msgspec.json.encode(CheckedFiles(files=tuple(documents)) if args.each else documents[0]))
    else:
        most = None if args.all else MOST
        texts = [line for document in documents for line in checked_text.lines(document, most)]
        print("\n".join(wrap_labelled(texts, wrapping.width(sys.stdout), checked_text.WIDTH)))
    codes = {check_document.exit_code(document, args.fail_on) for document in documents}
    return 1 if 1 in codes else CouldNotTell.exit_code if CouldNotTell.exit_code in codes else 0


def _files(args: argparse.Namespace) -> list[list[Path]]:
    """Return the files of each project; one without files is an environment."""
    if not args.files:
        if args.extra or args.group or args.each:
            message = "check: --extra, --group and --each are about files; name them with -r FILE"
            raise BadInput(message)
        return [[]]
    return [[path] for path in args.files] if args.each else [args.files]


def _read(args: argparse.Namespace, files: list[Path]) -> project.Project:
    if not files:
        return environment_at_hand.read_environment(args.python)
    try:
        python = str(Version(args.python)) if args.python else None
    except InvalidVersion:
        message = f'check: --python "{args.python}" is not a version; write one such as 3.11'
        raise BadInput(message) from None
    here = project.read_files(files, args.extra, args.group, python)
    unknown_names.refuse_unknown(here, files, lambda text: print(text, file=sys.stderr))
    return here

"""`simmatrix explain [FILE|-] [-- COMMAND...]`: name the cause of a failure and the fix, by `standalone/explain`."""

from __future__ import annotations

import argparse
import os
import re
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from harness.model.errors import BadInput, HarnessError
from harness.reports.explanations import explain_index
from harness.standalone.explain import explain
from harness.standalone.explain.explain import HELP, split
from harness.standalone.explain.explanation_text import Place
from harness.standalone.failures import matching

__all__ = ["HELP", "add_arguments", "main", "signatures", "split"]

FOLDER = "outputs"
MOST = 20
"""Outputs of failed commands that are kept below the state folder."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `explain`."""
    explain.add_arguments(parser)
    parser.usage = f"{parser.usage}\n       %(prog)s --id ID [--json]"
    parser.add_argument("--id", metavar="ID", help="show the known issue with this id; other verbs print such ids")


def main(args: argparse.Namespace) -> int:
    """Explain a text, or run the command and explain it where it fails, or open a known issue."""
    if args.id is not None:
        return _open(args.id)
    knows = explain.Knowledge(signatures=signatures, measured=explain_index.load_measured)
    try:
        if args.after is None:
            return explain.of_text(args, knows, Place())
        return explain.of_command(args, args.after, knows, Place(output_file=_output(args.after)))
    except explain.UsageError as error:
        raise BadInput(str(error)) from None


def _open(identifier: str) -> int:
    """Print a known issue; the exit code is 0. Raises BadInput."""
    from harness.judging import known_issues  # noqa: PLC0415 - start-up
    from harness.reports.answers import result_index  # noqa: PLC0415 - start-up
    from harness.reports.answers.recommended_text import wrap_line  # noqa: PLC0415 - start-up
    from harness.running.signatures import issue_texts  # noqa: PLC0415 - start-up

    issue = known_issues.find(identifier, issue_texts.load(), result_index.load().cells)
    width = shutil.get_terminal_size().columns
    print("\n".join(text for line in known_issues.lines(issue) for text in wrap_line(line, width)))
    return 0


def signatures() -> list[matching.Signature]:
    """Return the known failures in the form that the standalone modules read."""
    return explain_index.load_signatures()


def _output(command: Sequence[str]) -> str | None:
    """Create a file for a command's output, and remove the oldest such files. Return None if that is not possible."""
    from harness.machine import store  # noqa: PLC0415 - start-up

    name = re.sub(r"[^A-Za-z0-9.-]+", "-", Path(command[0]).name if command else "none")[:40]
    file = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{os.getpid()}-{name}.log"
    try:
        folder = store.open_store().folder / FOLDER
        folder.mkdir(exist_ok=True)
        for old in sorted(folder.glob("*.log"))[: -MOST + 1]:
            old.unlink(missing_ok=True)
        (folder / file).touch()
    except (OSError, HarnessError):
        # The command runs all the same, and its output is kept in a temporary file.
        return None
    return str(folder / file)

"""`simmatrix explain [FILE|-] [-- COMMAND...]`: why something failed, and what to do. `standalone/explain` does it."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from harness import knowledge, measured, store
from harness.errors import BadInput, HarnessError
from harness.reporttypes import DiagnosisEntry, FindingEntry
from harness.standalone import matching
from harness.standalone.explain import explain
from harness.standalone.explain.explain import HELP, add_arguments, split
from harness.standalone.explain.wording import Place

__all__ = ["HELP", "Explained", "add_arguments", "known", "main", "split"]

FOLDER = "outputs"
MOST = 20
"""Outputs of failed commands that are kept below the state folder."""


class Explained(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `explain --json`: `decisive` is the line that says why, None where nothing failed.

    `diagnoses` are known causes, the deepest first; none where the cause is unknown. `phase` is where it failed, as
    far as the text tells.
    """

    schema: int = 1
    decisive: str | None
    phase: str | None
    diagnoses: tuple[DiagnosisEntry, ...]
    findings: tuple[FindingEntry, ...]


def main(args: argparse.Namespace) -> int:
    """Explain a text, or run the command and explain it where it fails."""
    knows = explain.Knowledge(known=known, measured=measured.load)
    try:
        if args.after is None:
            return explain.of_text(args, knows, Place())
        return explain.of_command(args, args.after, knows, Place(kept=_output(args.after)))
    except explain.Bad as error:
        raise BadInput(str(error)) from None


def known() -> list[matching.Known]:
    """The known failures as what stands alone reads them."""
    return [matching.read(one.as_file) for one in knowledge.known()]


def _output(command: Sequence[str]) -> str | None:
    """The file that a command's output goes to; the oldest ones are removed. None where none can be made there."""
    name = re.sub(r"[^A-Za-z0-9.-]+", "-", Path(command[0]).name if command else "none")[:40]
    file = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{os.getpid()}-{name}.log"
    try:
        folder = store.open_store().folder / FOLDER
        folder.mkdir(exist_ok=True)
        for old in sorted(folder.glob("*.log"))[: -MOST + 1]:
            old.unlink(missing_ok=True)
        (folder / file).touch()
    except (OSError, HarnessError):
        return None
    return str(folder / file)

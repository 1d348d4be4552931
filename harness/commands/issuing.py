"""`show CELL --issue`: write a report for upstream from a red cell, with private names redacted."""

from __future__ import annotations

import getpass
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from harness.model import CellRecord, Phase, Verdict
from harness.model.errors import BadInput
from harness.model.report_types import UNTOLD, CellEntry, word
from harness.reports.issue import redacting, upstream
from harness.running.signatures import shipped_signatures

NOBODY = frozenset({"root", "user", "admin", "ubuntu", "debian", "runner", "nobody", "localhost", "home", "test"})
"""Names that say nothing of anybody, and words that a message may well have."""

INDEXES = ("UV_INDEX_URL", "UV_DEFAULT_INDEX", "UV_INDEX", "UV_EXTRA_INDEX_URL", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL")
PUBLIC = frozenset({"pypi.org", "files.pythonhosted.org", "download.pytorch.org"})


def issue(record: CellRecord, entry: CellEntry, machine: Mapping[str, Any], state: Path) -> str:
    """Return the redacted report of a red cell as text. Raises BadInput if the cell is not red.

    `machine` has the facts of the machine that it was measured on; below `state` lie its lock and its evidence.
    """
    refuse_green(entry)
    lock = _read(state / record.lock) if record.lock else None
    failing = upstream.Failing(
        cell=record.cell,
        entry=entry,
        machine=machine,
        lock=lock,
        instant=record.measured,
        texts=dict(_texts(record, entry, state)),
    )
    return redacting.redact(upstream.issue(failing), find_private_names())


def refuse_green(entry: CellEntry) -> None:
    """Raise BadInput for a cell that is not red."""
    if not is_red(entry):
        message = f"show {entry.id} --issue: it is {word(entry.verdict)}: there is nothing to report"
        raise BadInput(message)


def is_red(entry: CellEntry) -> bool:
    """Return whether a cell says something against its packages."""
    return entry.verdict is not Verdict.WORKS and entry.verdict not in UNTOLD


def _texts(record: CellRecord, entry: CellEntry, state: Path) -> Iterator[tuple[str, str]]:
    """Yield the evidence (name and text) of the deciding phase, if possible of a case with the cell's decisive line."""
    steps = {Phase.RESOLVE: record.resolve, Phase.INSTALL: record.install}
    step = steps.get(entry.phase) if entry.phase else None
    places = [step.log] if step and step.log else []
    phases = [phase for case in record.cases for phase in case.phases if phase.phase is entry.phase and phase.evidence]
    phases.sort(key=lambda phase: phase.decisive != entry.decisive)
    places += [phase.evidence or "" for phase in phases[:1]]
    for place in places:
        yield from shipped_signatures.texts(state / place).items()


def _read(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        # A lock that is gone or damaged costs the report only its lock.
        return None


def find_private_names() -> dict[str, str]:
    """Return the private names of this machine, its user and its indexes, each with its replacement."""
    replacements: dict[str, str] = {str(Path.home()): "~"}
    with suppress(OSError, KeyError):  # nobody of that number is known here
        replacements[getpass.getuser()] = "<user>"
    name = socket.gethostname()
    replacements |= {name: "<host>", name.partition(".")[0]: "<host>"}
    for variable in INDEXES:
        for part in os.environ.get(variable, "").split():
            # An entry of UV_INDEX may be NAME=ADDRESS; a `=` behind the `://` belongs to the address.
            host = urlsplit(part.partition("=")[2] if "=" in part.partition("://")[0] else part).hostname
            if host and host not in PUBLIC:
                replacements[host] = "<index>"
    # A name of one or two letters would be found in any text.
    return {
        word: instead for word, instead in replacements.items() if word and word.lower() not in NOBODY and len(word) > 2
    }

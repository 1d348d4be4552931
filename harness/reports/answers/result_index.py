"""Load all measured results as one document: those of the harness, of others, and of this store.

Results of others lie in the report folders that `HARNESS_RESULTS` names.
"""

from __future__ import annotations

import gzip
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from harness.machine import store
from harness.model import Plan, decoding
from harness.model.errors import BadInput
from harness.model.measured import Measured

VARIABLE = "HARNESS_RESULTS"
PACKAGE = Path(__file__).parents[2]
PACKED = PACKAGE / "measured.json.gz"
"""Made when a wheel is built, by `hatch_build.py`."""

NAME = "report.json"


def load() -> Measured:
    """Return all results. If a cell was measured twice on one machine, the newer result counts. Raises BadInput."""
    elsewhere = load_elsewhere()
    if not elsewhere:
        return load_shipped()
    from harness.reports.answers import digest  # noqa: PLC0415 - start-up

    return digest.combine([load_shipped(), *elsewhere])


def load_elsewhere() -> list[Measured]:
    """Return the results of others and of this store, without those that come with the harness. Raises BadInput."""
    others, own = files_of_others(), list(_own())
    if not others:
        return own
    from harness.reports.answers import digest  # noqa: PLC0415 - start-up

    return [digest.from_files(others), *own]


def load_plain() -> dict[str, Any]:
    """Return all results as `standalone` reads them. Raises BadInput."""
    plain: dict[str, Any] = msgspec.to_builtins(load())
    return plain


def load_shipped() -> Measured:
    """Return the results that come with the harness; a checkout collects them once for each state of its reports."""
    read = decoding.decoder(Measured).decode
    if PACKED.is_file():
        return read(gzip.decompress(PACKED.read_bytes()))
    # The code is part of the key: another version of it may make another document.
    rooms = ("model", "reports", "standalone/failures")
    files = [*report_files(), *(file for room in rooms for file in sorted((PACKAGE / room).rglob("*.py")))]
    marks = [(str(file), file.stat().st_mtime_ns, file.stat().st_size) for file in files]
    return store.load_or_make("distilled", repr(marks), _collected, read)


def _collected() -> bytes:
    from harness.reports.answers import digest  # noqa: PLC0415 - start-up

    return msgspec.json.encode(digest.from_files(report_files()))


def report_files() -> list[Path]:
    """Return the report files of a checkout; a wheel has none."""
    return sorted((PACKAGE.parent / "reports").glob(f"*/{NAME}"))


def files_of_others() -> list[Path]:
    """Return the report files in the folders that `HARNESS_RESULTS` names. Raises BadInput."""
    files: list[Path] = []
    for folder in (Path(name) for name in os.environ.get(VARIABLE, "").split(os.pathsep) if name):
        reports = sorted({*folder.glob(NAME), *folder.glob(f"*/{NAME}")})
        if not reports:
            message = f"{folder}: has no {NAME}, nor has a folder in it; {VARIABLE} names folders of reports"
            raise BadInput(message)
        files += reports
    return files


def _own() -> Iterator[Measured]:
    """Yield this store's results, judged and diagnosed as of now; a store that does not exist is not created."""
    # `store.state_folder` would make the folder.
    if not (Path(os.environ.get("HARNESS_STATE") or ".harness") / "cells").is_dir():
        return
    from harness.reports import document  # noqa: PLC0415 - start-up
    from harness.reports.answers import digest  # noqa: PLC0415 - start-up
    from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up

    opened = store.open_store()
    records = [record for record in opened.cells() if record.measured]
    planned = Plan(matrix="", cells=tuple({record.cell.id: record.cell for record in records}.values()), axes=())
    machines = {one.machine: opened.load_machine(one.machine) for one in records}
    knowledge = shipped_signatures.load_knowledge(opened.folder)
    yield digest.from_report(
        document.build(records, [planned], machines, store.now(), knowledge=knowledge), opened.folder
    )

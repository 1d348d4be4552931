"""Load the measured results: those that come with the harness, other people's, and this store's own.

A wheel carries the results of `reports/` as one compressed file, a checkout has `reports/` itself. Reports in the
folders that `HARNESS_RESULTS` (`DIR[:DIR]`) names are put on top of them, and then the results of this store. `digest`
describes the document.
"""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from harness.machine import store
from harness.machine.files import given_files
from harness.model import Plan, cellid
from harness.model.errors import BadInput
from harness.reports.answers import digest
from harness.reports.answers.digest import Layer
from harness.standalone.failures import counting

VARIABLE = "HARNESS_RESULTS"
PACKAGE = Path(__file__).parents[2]
PACKED = PACKAGE / "measured.json.gz"
"""Made when a wheel is built, by `hatch_build.py`."""

NAME = "report.json"


def load() -> dict[str, Any]:
    """Return all results. If a cell was measured twice on one machine, the newer result counts. Raises BadInput."""
    more = [*map(_report, files_of_others()), *_own()]
    return digest.combined([digest.to_layer(load_shipped()), *more]) if more else load_shipped()


def load_shipped() -> dict[str, Any]:
    """Return the results that come with the harness; a checkout distils them once for each state of its reports."""
    if PACKED.is_file():
        content = gzip.decompress(PACKED.read_bytes())
    else:
        # The code that distils is part of the key: another version of it may make another document.
        files = [*report_files(), Path(digest.__file__), Path(counting.__file__), Path(cellid.__file__)]
        marks = [(str(file), file.stat().st_mtime_ns, file.stat().st_size) for file in files]
        content = store.load_or_make("distilled", repr(marks), _distilled, msgspec.json.decode)
    document: dict[str, Any] = msgspec.json.decode(content)
    return document


def _distilled() -> bytes:
    return msgspec.json.encode(digest.combined(map(_report, report_files())))


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


def _report(path: Path) -> Layer:
    try:
        content = json.loads(given_files.read_content(path))
        content["cells"] = _renamed(content["cells"])
        return digest.layer(content, partial(_text, path.parent))
    # The file may be anybody's, and its shape was not checked: whatever is wrong becomes one sentence.
    except (BadInput, RecursionError, ValueError, KeyError, TypeError, AttributeError) as error:
        message = f"{path}: is no report of this harness: {type(error).__name__}: {error}"
        raise BadInput(message) from None


def _renamed(cells: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the cells of a report with ids in today's format."""
    names = {
        cell["id"]: cellid.to_current_form(
            cell["id"], cell["axes"], cell["requested_python"] if cell.get("base") else None
        )
        for cell in cells
    }
    for cell in cells:
        cell["id"] = names[cell["id"]]
        if cell.get("base"):
            cell["base"] = cellid.to_current_form(cell["base"], cell["axes"])
        for diagnosis in cell["diagnoses"]:
            diagnosis["proof"] = names.get(diagnosis.get("proof"), diagnosis.get("proof"))
    return cells


def _text(folder: Path, name: str) -> str | None:
    try:
        return (folder / name).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def _own() -> Iterator[Layer]:
    """Yield this store's results, judged and diagnosed as of now; a store that does not exist is not created."""
    # `store.state_folder` would make the folder.
    if not (Path(os.environ.get("HARNESS_STATE") or ".harness") / "cells").is_dir():
        return
    from harness.reports import document  # noqa: PLC0415 - start-up
    from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up

    opened = store.open_store()
    records = [record for record in opened.cells() if record.measured]
    planned = Plan(matrix="", cells=tuple({record.cell.id: record.cell for record in records}.values()), axes=())
    machines: Mapping[str, Mapping[str, Any]] = {one.machine: opened.load_machine(one.machine) for one in records}
    report = document.build(
        records, [planned], machines, store.now(), knowledge=shipped_signatures.beside(opened.folder)
    )
    yield digest.layer(json.loads(document.encode(report)), partial(_text, opened.folder))

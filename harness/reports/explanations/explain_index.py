"""Load what `explain` compares a text with: known failures and measured results, from one file made for it.

The file is made once for each state of the signatures and the reports, and kept below the cache folder. Reading it
needs the standard library alone, so that an answer comes at once.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.machine.files.cache_path import cache_path
from harness.running.signatures import signature_files
from harness.standalone.failures import literals, matching

if TYPE_CHECKING:
    from harness.model.measured import Measured

PACKAGE = Path(__file__).parents[2]
ROOMS = ("matrix", "model", "reports", "standalone/failures")
"""Rooms whose code makes what the file holds."""

KIND, ELSEWHERE = "explain", "explain-elsewhere"
MOST = 16
"""Files that are kept: several checkouts share a cache."""

Index = dict[str, Any]


def load_signatures() -> list[matching.Signature]:
    """Return the known failures in the form that the standalone modules read. Raises BadInput."""
    index = load_index()
    literals.remember(index["literals"])
    return [matching.read(plain) for plain in index["signatures"]]


def load_measured() -> dict[str, Any]:
    """Return of all measured cells what `explain` shows of one. Raises BadInput."""
    index, folder = load_index(), Path(os.environ.get("HARNESS_STATE") or ".harness") / "cells"
    elsewhere = _elsewhere(folder) if os.environ.get("HARNESS_RESULTS") or folder.is_dir() else []
    again = {cell["id"] for cell in elsewhere}
    shipped = [cell for cell in index["cells"] if cell["id"] not in again]
    return {"cells": [*shipped, *filter(_failed, elsewhere)], "overrides": index["overrides"]}


def _elsewhere(folder: Path) -> list[dict[str, Any]]:
    """Return what `explain` shows of cells of others and of this store, kept until one changes. Raises BadInput."""
    files = sorted(folder.rglob("*.json"))
    if os.environ.get("HARNESS_RESULTS"):
        from harness.reports.answers import result_index  # noqa: PLC0415 - start-up

        files += result_index.files_of_others()
    file = cache_path() / "remembered" / ELSEWHERE / _name(*files)
    with suppress(OSError, ValueError):
        cells: list[dict[str, Any]] = json.loads(file.read_bytes())
        return cells
    from harness.reports.answers import result_index  # noqa: PLC0415 - start-up

    cells = [plain for measured in result_index.load_elsewhere() for plain in _shown(measured)]
    _keep(file, json.dumps(cells).encode())
    return cells


@cache
def load_index() -> Index:
    """Return the contents of the file, which is made if there is none. Raises BadInput."""
    file = cache_path() / "remembered" / KIND / _name()
    with suppress(OSError, ValueError, KeyError):
        index: Index = json.loads(file.read_bytes())
        return {key: index[key] for key in ("signatures", "literals", "cells", "overrides")}
    collected = _make()
    _keep(file, json.dumps(collected).encode())
    return collected


def _name(*more: Path) -> str:
    """Return the name of the file: it differs where anything that it is made of differs."""
    place, files = signature_files.folder(), (*_sources(), *more)
    marks = [(str(file), entry.st_mtime_ns, entry.st_size) for file in files for entry in (file.stat(),)]
    return hashlib.sha256(repr((str(place), marks)).encode()).hexdigest()[:32]


def _sources() -> Iterator[Path]:
    yield from signature_files.files()
    packed = PACKAGE / "measured.json.gz"
    yield from [packed] if packed.is_file() else sorted((PACKAGE.parent / "reports").glob("*/report.json"))
    for room in ROOMS:
        yield from sorted((PACKAGE / room).rglob("*.py"))


def _make() -> Index:
    """Collect the known failures, the literals of their patterns, and the cells that failed."""
    from harness.reports.answers import measured_cells, result_index  # noqa: PLC0415 - start-up
    from harness.reports.explanations import overrides  # noqa: PLC0415 - start-up
    from harness.running.signatures import shipped_signatures  # noqa: PLC0415 - start-up

    signatures = [each.as_file for each in shipped_signatures.load_all()]
    measured = result_index.load_shipped()
    return {
        "signatures": signatures,
        "literals": literals_of(signatures),
        "cells": list(filter(_failed, _shown(measured))),
        "overrides": overrides.working_overrides(measured_cells.read(measured)),
    }


def _shown(measured: Measured) -> list[dict[str, Any]]:
    """Return of each cell what `explain` shows of it."""
    return [
        {"id": cell.id, "requirements": list(cell.requirements), "causes": list(cell.causes), "decisive": cell.decisive}
        for cell in measured.cells
    ]


def _failed(cell: Mapping[str, Any]) -> bool:
    return bool(cell["causes"] or cell["decisive"])


def literals_of(signatures: Sequence[dict[str, Any]]) -> dict[str, list[list[str]]]:
    """Return of each pattern the literals that a text must contain for it to match."""
    patterns = [each["pattern"] for each in signatures if each.get("pattern")]
    return {pattern: [sorted(clause) for clause in literals.clauses(pattern)] for pattern in patterns}


def _keep(file: Path, content: bytes) -> None:
    """Write the file, and remove the oldest of its kind; a cache that cannot be used costs only time."""
    from harness.machine import store  # noqa: PLC0415 - start-up
    from harness.model.errors import BadInput  # noqa: PLC0415 - start-up

    with suppress(OSError, BadInput):
        folder = store.cache_folder() / "remembered" / file.parent.name
        for old in sorted(folder.glob("*"), key=lambda each: each.stat().st_mtime)[: -MOST + 1]:
            old.unlink(missing_ok=True)
        store.write_atomic(folder / file.name, content)

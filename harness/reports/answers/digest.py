"""Make one document of measured results from reports: their cells and locks, without explanations.

The hook that builds our wheel runs it, too, where only msgspec, packaging and tomli-w are installed.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec

from harness.judging.known_failures import select_counting
from harness.model.measured import Measured, MeasuredCell, ReleaseSeries
from harness.model.report_types import UNTOLD, CaseEntry, CellEntry, Document
from harness.reports import document
from harness.reports.answers.release_series import read_series
from harness.standalone.failures.remedies import describe_steps

PIN = re.compile(r"^([\w.-]+)==(\S+)((?: \\\n +--hash=sha256:[0-9a-f]{64})+)$", re.MULTILINE)
HASH = re.compile(r"sha256:([0-9a-f]{64})")


def from_files(reports: Iterable[Path]) -> Measured:
    """Return the measured cells of these `report.json` files. Raises BadInput."""
    return combine(from_report(document.read_file(path), path.parent) for path in reports)


def from_report(report: Document, folder: Path) -> Measured:
    """Return the measured cells of a report; `folder` holds its files.

    Cells whose verdict says nothing of the packages are left out.
    """
    cells = [cell for cell in report.cells if cell.verdict not in UNTOLD and cell.machine and cell.measured]
    texts = {name: _text(folder, name) for name in {cell.lock for cell in cells if cell.lock}}
    # Only a lock that `lock_text` can restore to the byte is named.
    whole = {name: text for name, text in texts.items() if text and not PIN.sub("", text).strip()}
    named = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in whole.items()}
    measured = with_locks(
        report.generated,
        report.machines,
        [_cell(cell, named.get(cell.lock or ""), folder) for cell in cells],
        {sha: texts[name] for name, sha in named.items()},
        {one.signature: describe_remedy(one.remedy) for cell in cells for one in cell.diagnoses},
    )
    return msgspec.structs.replace(measured, series=tuple(read_series(report)))


def combine(parts: Iterable[Measured]) -> Measured:
    """Return these results as one document. If a cell was measured twice on one machine, the newer result counts."""
    generated = ""
    machines: dict[str, dict[str, object]] = {}
    locks: dict[str, str] = {}
    cells: dict[tuple[str, str], MeasuredCell] = {}
    remedies: dict[str, str] = {}
    series: list[ReleaseSeries] = []
    for part in parts:
        series += part.series
        generated = max(generated, part.generated)
        machines |= part.machines
        remedies |= part.remedies
        locks |= {sha: part.lock_text(sha) for sha in part.locks}
        for cell in part.cells:
            key = cell.id, cell.machine
            # At equal times the later one wins: `result_index` puts this store's own results last.
            if key not in cells or cells[key].measured <= cell.measured:
                cells[key] = cell
    measured = with_locks(generated, machines, [cells[key] for key in sorted(cells)], locks, remedies)
    return msgspec.structs.replace(measured, series=tuple(series))


def pack(measured: Measured) -> bytes:
    """Compress the document; equal documents give equal bytes."""
    # gzip would write the time into its header.
    return gzip.compress(msgspec.json.encode(measured, order="deterministic"), compresslevel=9, mtime=0)


def pack_reports(files: Iterable[Path]) -> bytes:
    """Return whole reports as one zip file, without the files beside them; equal for equal reports."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in sorted(files):
            member = zipfile.ZipInfo(f"{path.parent.name}.json", (1980, 1, 1, 0, 0, 0))
            member.compress_type = zipfile.ZIP_DEFLATED
            report = document.relocate(document.read_file(path), lambda _: "")
            archive.writestr(member, msgspec.json.encode(report, order="deterministic"), compresslevel=9)
    return buffer.getvalue()


# --- one cell --------------------------------------------------------------------------------------------------


def _cell(cell: CellEntry, lock: str | None, folder: Path) -> MeasuredCell:
    noted = any(case.exercised is not msgspec.UNSET for case in cell.cases)
    bare = document.relocate_cell(cell, lambda _: "")
    fields = {name: getattr(bare, name) for name in bare.__struct_fields__}
    return MeasuredCell(
        **fields
        | {
            "lock": lock,
            "cases": tuple(map(_slim, bare.cases)),
            "installed": None if lock else bare.installed,
            "diagnoses": (),
            "findings": (),
            "causes": tuple(one.signature for one in select_counting(cell)),
            "imported": () if noted or not cell.evidence else _imported(_text(folder, f"{cell.evidence}/reply.jsonl")),
        }
    )


def _slim(case: CaseEntry) -> CaseEntry:
    """Return a case without its texts and pictures, which no answer shows: it is read at each call of a verb."""
    # A Dockerfile needs the libraries of the way in which it was drawn.
    drawn = {"api": case.drawn["api"]} if "api" in case.drawn else {}
    return msgspec.structs.replace(case, reasons={}, masked={}, evidence={}, drawn=drawn, told=msgspec.UNSET)


def describe_remedy(remedy: Mapping[str, Any]) -> str:
    """Return in a few words what to do: the steps that a machine can take, else the first sentence of the text."""
    first, _, _ = str(remedy.get("text", "")).partition(". ")
    return "; ".join(describe_steps(remedy)) or first.rstrip(".")


def _imported(reply: str) -> tuple[str, ...]:
    """Return the modules that one case is known to have imported: those that it names, and well-known libraries."""
    modules: set[str] = set()
    for line in reply.splitlines():
        if '"import.modules"' in line or '"end"' in line:
            with suppress(ValueError, AttributeError, TypeError, RecursionError):  # a cell may have written anything
                record = json.loads(line)
                modules |= {*(record.get("facts") or {}).get("seconds", ()), *(record.get("versions") or ())}
    return tuple(sorted(map(str, modules)))


def _text(folder: Path, name: str) -> str:
    """Return the text of a file of a report; empty if it is gone."""
    try:
        return (folder / name).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


# --- locks -----------------------------------------------------------------------------------------------------


def with_locks(
    generated: str,
    machines: Mapping[str, dict[str, object]],
    cells: Collection[MeasuredCell],
    locks: Mapping[str, str],
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> Measured:
    """Return cells with the machines, locks and known failures that they name. `locks` are texts by their SHA-256."""
    used = {cell.lock for cell in cells}
    causes = {name for cell in cells for name in cell.causes}
    pins = {
        sha: [(name, version, tuple(HASH.findall(hashes))) for name, version, hashes in PIN.findall(text)]
        for sha, text in sorted(locks.items())
        if sha in used
    }
    release_hashes: dict[str, set[str]] = {}
    for name, version, hashes in (pin for each in pins.values() for pin in each):
        release_hashes.setdefault(f"{name}=={version}", set()).update(hashes)
    ordered = {release: tuple(sorted(hashes)) for release, hashes in sorted(release_hashes.items())}
    taken = {sha: dict(_hash_positions(each, ordered)) for sha, each in pins.items()}
    return Measured(
        generated=generated,
        machines={name: machines[name] for name in sorted({cell.machine for cell in cells} & {*machines})},
        cells=tuple(cells),
        locks={sha: tuple((name, version) for name, version, _ in each) for sha, each in pins.items()},
        hashes=ordered,
        taken={sha: places for sha, places in taken.items() if places},
        remedies={name: text for name, text in sorted(remedies.items()) if name in causes},
    )


def _hash_positions(
    pins: Iterable[tuple[str, str, tuple[str, ...]]], release_hashes: Mapping[str, tuple[str, ...]]
) -> Iterator[tuple[str, tuple[int, ...]]]:
    for name, version, hashes in pins:
        all_of_it = release_hashes[f"{name}=={version}"]
        # The places keep the lock's own order, too: the same hashes in another order are another text.
        if hashes != all_of_it:
            yield name, tuple(all_of_it.index(one) for one in hashes)

"""Combine reports into one plain JSON document of measured cells and their locks, without explanations.

It uses the standard library and `standalone` alone, because the hook that builds our wheel runs it, too. `layer` reads
a report, `combined` puts layers on one another, and `lock_text` restores a lock to the byte. The document:

    {"schema": 1, "generated": "...Z", "machines": {ID: {"os", "libc", "glibc", "architecture", "gl", "gpu"}},
     "cells": [...], "locks": {SHA-256: [[name, version], ...]}, "hashes": {"name==version": [SHA-256 of files]},
     "taken": {SHA-256: {name: [places in its hashes]}}}

`taken` says which files of a release a lock holds, if it does not hold all of them.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from harness.standalone.failures.counting import Fit, is_stated, select_counting

Plain = Mapping[str, Any]

SCHEMA = 1
UNTOLD = frozenset({"not_run", "unavailable", "inconclusive"})
"""Verdicts that say nothing of the packages, so that nothing is left of their cells."""

PIN = re.compile(r"^([\w.-]+)==(\S+)((?: \\\n +--hash=sha256:[0-9a-f]{64})+)$", re.MULTILINE)
HASH = re.compile(r"sha256:([0-9a-f]{64})")
COPIED = ("id", "matrix", "python", "machine", "measured", "verdict", "unverified", "phase", "phases", "axes")
LATER = ("environment", "supplied", "requirements", "decisive")
OF_CASE = ("case", "env", "api", "phases", "decisive", "misleads", "unverified", "exercised")
OWN = 2
"""Colons in the id of an environment (`gym:module:function`) that a matrix brings itself."""


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Measured cells of some reports: plain cells, facts of machines, and texts of locks by their SHA-256."""

    generated: str = ""
    machines: Mapping[str, Plain] = field(default_factory=dict)
    cells: Sequence[Plain] = ()
    locks: Mapping[str, str] = field(default_factory=dict)


def layer(report: Plain, text: Callable[[str], str | None]) -> Layer:
    """Return the measured cells of a report document as a layer.

    `text` returns the content of a file that the document names, None if it is gone. Cells whose verdict says nothing
    of the packages are left out.
    """
    cells = [cell for cell in report["cells"] if cell["verdict"] not in UNTOLD and cell["machine"] and cell["measured"]]
    texts = {name: text(name) for name in {cell["lock"] for cell in cells if cell["lock"]}}
    # Only a lock that `lock_text` can restore to the byte is named.
    named = {name: _sha256(content) for name, content in texts.items() if content and _is_lock(content)}
    return Layer(
        generated=report["generated"],
        machines={name: _machine(facts) for name, facts in report["machines"].items()},
        cells=[_cell(cell, named.get(cell["lock"]), text) for cell in cells],
        locks={sha: texts[name] or "" for name, sha in named.items()},
    )


def combined(layers: Iterable[Layer]) -> dict[str, Any]:
    """Return the layers as one document. If a cell was measured twice on one machine, the newer result counts."""
    generated = ""
    machines: dict[str, Plain] = {}
    locks: dict[str, str] = {}
    cells: dict[tuple[str, str], Plain] = {}
    for report_layer in layers:
        generated = max(generated, report_layer.generated)
        machines.update(report_layer.machines)
        locks.update(report_layer.locks)
        for cell in report_layer.cells:
            key = cell["id"], cell["machine"]
            # At equal times the later layer wins: `result_index` puts this store's own results last.
            if key not in cells or cells[key]["measured"] <= cell["measured"]:
                cells[key] = cell
    used = {cell["lock"] for cell in cells.values()}
    return {
        "schema": SCHEMA,
        "generated": generated,
        "machines": {name: dict(machines[name]) for name in sorted({machine for _, machine in cells} & set(machines))},
        "cells": [dict(cells[key]) for key in sorted(cells)],
        **_locks({sha: text for sha, text in sorted(locks.items()) if sha in used}),
    }


def to_layer(document: Plain) -> Layer:
    """Return a document as a layer, so that it can be combined with others."""
    return Layer(
        generated=document["generated"],
        machines=document["machines"],
        cells=document["cells"],
        locks={sha: lock_text(document, sha) for sha in document["locks"]},
    )


def lock_text(document: Plain, sha256: str) -> str:
    """Return a lock of the document as hash-pinned requirements, as they were measured."""
    taken = document["taken"].get(sha256, {})
    lines = []
    for name, version in document["locks"][sha256]:
        release_hashes = document["hashes"][f"{name}=={version}"]
        hashes = [release_hashes[place] for place in taken[name]] if name in taken else release_hashes
        lines.append(" \\\n".join((f"{name}=={version}", *(f"    --hash=sha256:{one}" for one in hashes))) + "\n")
    return "".join(lines)


def packed(document: Plain) -> bytes:
    """Compress the document; equal documents give equal bytes."""
    buffer = io.BytesIO()
    # gzip would write the time into its header.
    with gzip.GzipFile(filename="", mode="wb", compresslevel=9, fileobj=buffer, mtime=0) as file:
        file.write(json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode())
    return buffer.getvalue()


def unpacked(content: bytes) -> dict[str, Any]:
    """Return the document from the bytes that `packed` made."""
    document: dict[str, Any] = json.loads(gzip.decompress(content))
    return document


def packed_reports(reports: Mapping[str, Plain]) -> bytes:
    """Return whole reports as one zip file, without the files beside them; equal for equal reports."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, report in sorted(reports.items()):
            member = zipfile.ZipInfo(f"{name}.json", (1980, 1, 1, 0, 0, 0))
            member.compress_type = zipfile.ZIP_DEFLATED
            text = json.dumps(_strip_file_names(report), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
            archive.writestr(member, text.encode(), compresslevel=9)
    return buffer.getvalue()


def _strip_file_names(report: Plain) -> dict[str, Any]:
    """Return a report without the names of its files."""
    cells = []
    for cell in report["cells"]:
        cases = [{**case, "frames": [], "evidence": {}} for case in cell["cases"]]
        suite = {**cell["suite"], "evidence": None} if cell.get("suite") else None
        cells.append({**cell, "cases": cases, "evidence": None, "lock": None, "suite": suite})
    return {**report, "cells": cells}


# --- one report ------------------------------------------------------------------------------------------------


def _cell(cell: Plain, lock: str | None, text: Callable[[str], str | None]) -> dict[str, Any]:
    entry = {key: cell.get(key) for key in (*COPIED, *LATER)}
    expectation = cell.get("expectation") or {}
    entry |= {
        "cases": [{key: case[key] for key in OF_CASE if key in case} for case in cell["cases"]],
        "lock": lock,
        "imported": [] if any("exercised" in case for case in cell["cases"]) else _imported(cell["evidence"], text),
        "causes": _causes(cell),
        "proofs": {one["signature"]: one["proof"] for one in cell["diagnoses"] if one.get("proof")},
        "repairs": [{key: one[key] for key in ("package", "version", "reason", "link")} for one in cell["repairs"]],
        "reason": expectation.get("reason"),
        "link": expectation.get("link"),
        "base": cell.get("base"),
        "change": (cell.get("change") or {}).get("change"),
        "brought": [one["name"] for one in cell.get("brought") or ()],
        "subject": (cell.get("subject") or {}).get("name"),
        "own": all((case["env"] or "").count(":") >= OWN for case in cell["cases"]) and bool(cell["cases"]),
    }
    return {key: value for key, value in entry.items() if value or key in REQUIRED_KEYS}


REQUIRED_KEYS = frozenset({*COPIED, *LATER, "cases", "lock", "causes", "repairs"})
"""Keys that every cell has; any other one is left out where there is nothing to say."""


def _imported(evidence: str | None, text: Callable[[str], str | None]) -> list[str]:
    """Return the modules that one case is known to have imported: those that it names, and well-known libraries."""
    modules: set[str] = set()
    for line in (text(f"{evidence}/reply.jsonl") or "" if evidence else "").splitlines():
        if '"import.modules"' in line or '"end"' in line:
            with suppress(ValueError, AttributeError, TypeError, RecursionError):  # a cell may have written anything
                record = json.loads(line)
                modules |= {*(record.get("facts") or {}).get("seconds", ()), *(record.get("versions") or ())}
    return sorted(map(str, modules))


def _causes(cell: Plain) -> list[str]:
    """Return the ids of the known failures that count."""
    lines = [cell["decisive"] or "", *(line for case in cell["cases"] for line in case.get("reasons", {}).values())]
    return list(select_counting(_fit(one, lines) for one in cell["diagnoses"]))


def _fit(diagnosis: Plain, lines: Sequence[str]) -> Fit:
    seen = diagnosis.get("seen", "")
    return Fit(
        diagnosis["signature"], diagnosis["masks"], diagnosis.get("generic", False), seen, is_stated(seen, lines)
    )


def _machine(facts: Plain) -> dict[str, Any]:
    libc = str(facts.get("libc", ""))
    ways = [facts.get(way) or {} for way in ("egl", "osmesa", "display")]
    drawing: Plain = next((way for way in ways if way.get("vendor")), {})
    entry = {
        "os": facts.get("os"),
        "libc": libc,
        "glibc": libc.partition(" ")[2] if libc.startswith("glibc ") else None,
        "architecture": facts.get("architecture"),
        "gl": drawing.get("vendor"),
        "gl_version": drawing.get("version"),
        "gpu": (facts.get("gpu") or {}).get("models"),
    }
    return {name: fact for name, fact in entry.items() if fact}


def _is_lock(text: str) -> bool:
    return not PIN.sub("", text).strip()


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


# --- locks -----------------------------------------------------------------------------------------------------


def _pins(text: str) -> Iterator[tuple[str, str, list[str]]]:
    for name, version, hashes in PIN.findall(text):
        yield name, version, HASH.findall(hashes)


def _locks(texts: Mapping[str, str]) -> dict[str, Any]:
    """Return the `locks`, `hashes` and `taken` of the document.

    Locks become pairs of name and version. The hashes of each release are written once, and `taken` lists those that a
    lock holds if it does not hold all.
    """
    read = {sha: list(_pins(text)) for sha, text in texts.items()}
    release_hashes: dict[str, set[str]] = {}
    for name, version, hashes in (pin for pins in read.values() for pin in pins):
        release_hashes.setdefault(f"{name}=={version}", set()).update(hashes)
    ordered = {release: sorted(hashes) for release, hashes in sorted(release_hashes.items())}
    taken = {sha: dict(_hash_positions(pins, ordered)) for sha, pins in read.items()}
    return {
        "locks": {sha: [[name, version] for name, version, _ in pins] for sha, pins in read.items()},
        "hashes": ordered,
        "taken": {sha: places for sha, places in taken.items() if places},
    }


def _hash_positions(
    pins: Iterable[tuple[str, str, list[str]]], release_hashes: Mapping[str, list[str]]
) -> Iterator[tuple[str, list[int]]]:
    for name, version, hashes in pins:
        all_of_it = release_hashes[f"{name}=={version}"]
        # The places keep the lock's own order, too: the same hashes in another order are another text.
        if hashes != all_of_it:
            yield name, [all_of_it.index(one) for one in hashes]

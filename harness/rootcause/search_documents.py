"""Write what a search found: one document as JSON and as a page, with the locks that belong to it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from harness.machine import store
from harness.reports.template_files import fill, read_template
from harness.reports.text import report_markdown
from harness.rootcause.bench import Trial

D = TypeVar("D", bound=msgspec.Struct)


def trial_fields(trial: Trial) -> dict[str, Any]:
    """Return the fields that an entry on a run has in every document."""
    judged, record = trial.assessed, trial.record
    return {
        "verdict": judged.verdict,
        "phase": judged.phase,
        "decisive": judged.decisive,
        "causes": tuple(each.signature.id for each in judged.diagnoses),
        "lock_sha256": record.lock_sha256,
        "key": record.key,
        "python": record.python,
        "seconds": trial.seconds,
        "at_hand": trial.at_hand,
    }


def page(template: str, document: msgspec.Struct, **more: Any) -> str:
    """Return a document as a page, from a template that has its fields as variables, and `more`."""
    values = msgspec.structs.asdict(document) | more
    return fill(read_template(template), report_markdown.filters(), **values)


def as_json(document: msgspec.Struct) -> bytes:
    """Return a document as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(document))


def write(document: D, stem: Path, locks: Mapping[str, Path], render: Callable[[D], str]) -> D:
    """Write a document to `stem` as .json and .md, and beside it copies of locks by their names there.

    Return the document with the paths of all files, from the working folder.
    """
    files = [stem.with_suffix(".json"), stem.with_suffix(".md"), *(stem.parent / name for name in locks)]
    for name, lock in locks.items():
        store.write_atomic(stem.parent / name, lock.read_bytes())
    document = msgspec.structs.replace(document, files=tuple(path.name for path in files))
    store.write_atomic(files[0], as_json(document) + b"\n")
    store.write_atomic(files[1], render(document).encode())
    return msgspec.structs.replace(document, files=tuple(os.path.relpath(path) for path in files))

"""The measured results that are at hand: those that come with the harness, other people's, and this store's own.

A wheel carries those behind `reports/` as one compressed file, a checkout has `reports/` itself. `HARNESS_RESULTS`
(`DIR[:DIR]`) names folders of reports to be put upon them, and what this store measured lies on top. What the document
holds stands in `distilling`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from harness import distilling, document, knowledge, store
from harness.distilling import Layer
from harness.errors import BadInput
from harness.model import Plan

VARIABLE = "HARNESS_RESULTS"
PACKAGE = Path(__file__).parent
PACKED = PACKAGE / "measured.json.gz"
"""Made when a wheel is built, by `hatch_build.py`."""

NAME = "report.json"


def load() -> dict[str, Any]:
    """Everything at hand; of a cell measured twice on one machine the newer measurement stands. Raises BadInput."""
    return distilling.combined([*_with_us(), *_of_others(), *_own()])


def shipped() -> dict[str, Any]:
    """What comes with the harness alone."""
    return distilling.combined(_with_us())


def _with_us() -> Iterator[Layer]:
    if PACKED.is_file():
        yield distilling.again(distilling.unpacked(PACKED.read_bytes()))
    else:
        yield from map(_report, sorted((PACKAGE.parent / "reports").glob(f"*/{NAME}")))


def _of_others() -> Iterator[Layer]:
    for folder in (Path(name) for name in os.environ.get(VARIABLE, "").split(os.pathsep) if name):
        found = sorted({*folder.glob(NAME), *folder.glob(f"*/{NAME}")})
        if not found:
            message = f"{folder}: has no {NAME}, nor has a folder in it; {VARIABLE} names folders of reports"
            raise BadInput(message)
        yield from map(_report, found)


def _report(path: Path) -> Layer:
    try:
        content = json.loads(path.read_bytes())
        return distilling.layer(content, partial(_text, path.parent))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        message = f"{path}: is no report of this harness: {type(error).__name__}: {error}"
        raise BadInput(message) from None


def _text(folder: Path, name: str) -> str | None:
    try:
        return (folder / name).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def _own() -> Iterator[Layer]:
    """What this store measured, judged and diagnosed as of now; no store is made where there is none."""
    if not (Path(os.environ.get("HARNESS_STATE") or ".harness") / "cells").is_dir():
        return
    opened = store.open_store()
    records = [record for record in opened.cells() if record.measured]
    planned = Plan(matrix="", cells=tuple({record.cell.id: record.cell for record in records}.values()), axes=())
    machines: Mapping[str, Mapping[str, Any]] = {one.machine: opened.load_machine(one.machine) for one in records}
    made = document.build(records, [planned], machines, store.now(), known=knowledge.beside(opened.folder))
    yield distilling.layer(json.loads(document.encode(made)), partial(_text, opened.folder))

"""Find and open the reports that come with the harness and those that `HARNESS_RESULTS` names.

A checkout has them in `reports/`. A wheel has them as one file. A report that is asked for is unpacked from it into the
cache folder, without frames and logs.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from pathlib import Path

from harness.machine import store
from harness.model.report_types import Document
from harness.reports import document
from harness.reports.answers import result_index

PACKED = result_index.PACKAGE / "reports.zip"
"""Made when a wheel is built, by `hatch_build.py`; its members are `NAME.json`."""


def names() -> list[str]:
    """Return the names of the reports."""
    if PACKED.is_file():
        with zipfile.ZipFile(PACKED) as archive:
            packed = [name.removesuffix(".json") for name in archive.namelist()]
    else:
        packed = [path.parent.name for path in result_index.report_files()]
    return sorted({*packed, *(path.parent.name for path in result_index.files_of_others())})


def path(name: str) -> Path | None:
    """Return the `report.json` of a report, or None if no report has this name."""
    files = [*result_index.files_of_others(), *result_index.report_files()]
    report_file = next((file for file in files if file.parent.name == name), None)
    return report_file or _unpacked(name)


@cache
def load(name: str) -> tuple[Document, Path] | None:
    """Return a report and its file, or None if no report has this name."""
    file = path(name)
    return (document.read_file(file), file) if file else None


def load_all() -> Iterator[tuple[Document, Path]]:
    """Yield every report and its file."""
    yield from filter(None, map(load, names()))


def _unpacked(name: str) -> Path | None:
    """Unpack a report of the wheel into the cache folder and return its file, or None if the wheel lacks it."""
    if not PACKED.is_file():
        return None
    with zipfile.ZipFile(PACKED) as archive:
        if f"{name}.json" not in archive.namelist():
            return None
        content = archive.read(f"{name}.json")
    # The hash in the path makes a file that is there never out of date, also where several versions share a cache.
    file = store.cache_folder() / "reports" / sha256(content).hexdigest()[:16] / name / result_index.NAME
    if not file.is_file():
        store.write_atomic(file, content)
    return file

"""Build `simmatrix-doctor.pyz`: the standalone package, the known failures and the measured results in one file.

Equal contents give an equal file: no time, no order and no path of this machine gets into it.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from pathlib import Path

from harness.machine import store
from harness.matrix.signatures import Signature
from harness.model.measured import Measured
from harness.reports.answers import digest, result_index
from harness.reports.explanations import explain_index
from harness.running import open_matrix
from harness.running.signatures import shipped_signatures
from harness.standalone import adapters

PACKAGE = Path(__file__).parent.parent / "standalone"
INSIDE = "simmatrix_doctor"
"""The name of the package in the file: no library is called so."""

SHEBANG = b"#!/usr/bin/env python3\n"
# Any Python 3 must be able to compile this text, so that one that is too old can say so: `%`, no newer syntax.
START = f"""\
import sys

if sys.version_info < (3, 7):
    sys.exit("simmatrix-doctor: needs Python 3.7 or newer, this is %d.%d" % sys.version_info[:2])
sys.dont_write_bytecode = True
from {INSIDE}.__main__ import console

console()
"""
WHEN = (1980, 1, 1, 0, 0, 0)
"""The time of every member, the first that a zip file knows."""

EXECUTABLE = 0o755


def write(path: Path) -> None:
    """Write the file to a path, atomically. Raises BadInput if signatures or results cannot be read."""
    store.write_atomic(path, content(shipped_signatures.load_all(), result_index.load_shipped()))
    path.chmod(EXECUTABLE)


def content(signatures: tuple[Signature, ...], results: Measured) -> bytes:
    """Return the bytes of the whole file."""
    files = (*PACKAGE.rglob("*.py"), *PACKAGE.glob("vendored/*/LICENSE*"))
    ours = {file.relative_to(PACKAGE).as_posix(): file for file in sorted(files)}
    plain = [one.as_file for one in signatures]
    members = {
        "__main__.py": START.encode(),
        **{f"{INSIDE}/{name}": file.read_bytes() for name, file in ours.items()},
        f"{INSIDE}/signatures.json": json.dumps(plain, sort_keys=True).encode(),
        f"{INSIDE}/literals.json": json.dumps(explain_index.literals_of(plain), sort_keys=True).encode(),
        f"{INSIDE}/{adapters.CARRIED}": adapters.encode_declarations(),
        f"{INSIDE}/measured.json.gz": digest.pack(results),
        **{
            f"{INSIDE}/history/{file.name}": file.read_bytes()
            for file in sorted((open_matrix.data_folder() / "history").glob("*.json.gz"))
        },
    }
    buffer = io.BytesIO(SHEBANG)
    # Without the seek the archive would overwrite the first line.
    buffer.seek(0, os.SEEK_END)
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, data in members.items():
            member = zipfile.ZipInfo(name, WHEN)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.external_attr = 0o644 << 16
            archive.writestr(member, data)
    return buffer.getvalue()

"""Repair metadata lines of a wheel: the result is the same to the byte wherever it is made.

It is written anew: files in order, not compressed (zlib differs between machines), times fixed, and the requirements
in its metadata in order (gym's setup.py takes them from a set).
"""

from __future__ import annotations

import base64
import hashlib
import io
import re
import zipfile
from collections.abc import Iterator, Mapping

from harness.model import Repair

OLDEST = (1980, 1, 1, 0, 0, 0)
"""The oldest time that a zip file can hold."""

SORTED = ("Provides-Extra", "Requires-Dist")
"""Fields whose lines mean the same in whatever order."""

PURE = re.compile(rb"(?m)^Root-Is-Purelib: true\s*$")


class Unrepairable(Exception):
    """A wheel is not the one that its recipe was written for."""


def repair_wheel(wheel: bytes, repair: Repair) -> bytes:
    """Return the wheel with its metadata repaired and its RECORD corrected. Raises Unrepairable."""
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        entries = {info.filename: info for info in archive.infolist() if not info.is_dir()}
        contents = {name: archive.read(info) for name, info in entries.items()}
    folder = next((name.partition("/")[0] for name in contents if name.endswith(".dist-info/METADATA")), None)
    if folder is None or not PURE.search(contents.get(f"{folder}/WHEEL", b"")):
        message = f"{repair.name} {repair.version}: only a wheel that fits every machine can be repaired"
        raise Unrepairable(message)
    contents[f"{folder}/METADATA"] = _metadata(contents[f"{folder}/METADATA"].decode(), repair).encode()
    record = f"{folder}/RECORD"
    del contents[record]
    rows = [f"{_quoted(name)},sha256={_digest(contents[name])},{len(contents[name])}" for name in sorted(contents)]
    contents[record] = "".join(f"{row}\n" for row in (*rows, f"{record},,")).encode()
    executable = {name for name, info in entries.items() if (info.external_attr >> 16) & 0o100}
    # The wheel standard wants RECORD to be the last file.
    return _zipped({name: contents[name] for name in (*sorted(contents.keys() - {record}), record)}, executable)


def sha256(content: bytes) -> str:
    """Return the SHA-256 of the content, as locks write it."""
    return hashlib.sha256(content).hexdigest()


def _metadata(text: str, repair: Repair) -> str:
    """Return the edited metadata. Raises Unrepairable if an edit finds no line: a recipe that does nothing is wrong."""
    head, blank, body = text.partition("\n\n")
    lines = head.split("\n")
    for edit in repair.edits:
        start = f"{edit.field}: {edit.old}"
        if not any(line.startswith(start) for line in lines):
            message = f"{repair.name} {repair.version}: its metadata has no line that begins with `{start}`"
            raise Unrepairable(message)
        lines = [f"{edit.field}: {edit.new}{line.removeprefix(start)}" if line.startswith(start) else line
                 for line in lines]  # fmt: skip
    return "\n".join(_in_order(lines)) + blank + body


def _in_order(lines: list[str]) -> Iterator[str]:
    """Yield the other fields as they are, then extras and requirements in sorted order."""
    many = [line for line in lines if line.partition(":")[0] in SORTED]
    yield from (line for line in lines if line and line not in many)
    yield from sorted(many)
    yield from (line for line in lines if not line)


def _quoted(name: str) -> str:
    """Return a name as a CSV file quotes it."""
    return '"' + name.replace('"', '""') + '"' if re.search(r'[,"]', name) else name


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")


def _zipped(contents: Mapping[str, bytes], executable: set[str]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, OLDEST)
            info.create_system = 3  # Unix, wherever it is written
            info.external_attr = (0o100755 if name in executable else 0o100644) << 16
            archive.writestr(info, content)
    return file.getvalue()

"""Read the metadata of one installed package as untrusted data."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from email.parser import HeaderParser
from functools import cached_property
from importlib.metadata import Distribution, PackageMetadata
from pathlib import Path

from harness.machine.files import guarded_files
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable

BLANK = re.compile(r"\r?\n\r?\n")
MOST_METADATA = 64 << 20
"""Bytes of a file of metadata: the longest RECORD is some megabytes."""


class Installed(Distribution):
    """An installed package. Its metadata are read as untrusted data: anything may have happened to the file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read_text(self, filename: str) -> str | None:
        """Return a file of its metadata; bytes that are no UTF-8 are replaced. Raises Unreadable."""
        try:
            return guarded_files.read(self.folder / filename, MOST_METADATA).decode("utf-8", "replace")
        except Absent:
            return None

    def locate_file(self, path: object) -> Path:
        """Return where one of its files lies."""
        return self.folder.parent / str(path)

    @cached_property
    def metadata(self) -> PackageMetadata:
        """Return the fields of its metadata, read once; the long description below them is left out."""
        texts = (self.read_text(name) for name in ("METADATA", "PKG-INFO", ""))
        text = next(filter(None, texts), "")
        # The fields end at the first empty line; what follows can be a book of licences.
        end = BLANK.search(text)
        return HeaderParser().parsestr(text[: end.start()] if end else text)  # type: ignore[return-value]

    @property
    def name(self) -> str:
        """Return its name. Raises Unreadable."""
        return self._read_field("Name")

    @property
    def version(self) -> str:
        """Return its version. Raises Unreadable."""
        return self._read_field("Version")

    def paths(self) -> Iterable[str]:
        """Return the paths of its files as its RECORD lists them; where it has none, as its other metadata do."""
        record = self.read_text("RECORD")  # `files` makes a path of every row, which takes three times as long
        if record is None:
            return map(str, self.files or ())
        return (row[0] for row in csv.reader(record.splitlines()) if row)

    def _read_field(self, key: str) -> str:
        with raise_unreadable():
            if key in self.metadata and (value := str(self.metadata[key]).strip()):
                return value
        message = f"{self.folder.name} says no {key}"
        raise Unreadable(message)

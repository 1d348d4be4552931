"""Read an sdist only until the places that matter have passed, and keep some of its files."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable, Sequence
from pathlib import Path

from harness.model import Artifact
from harness.packages import index

PART = 1 << 20
"""Bytes that are asked for at once."""

BLOCK = 1 << 16
"""Bytes that are unpacked at once."""

METADATA = ("PKG-INFO", "entry_points.txt", "requires.txt")


def is_metadata(member: str) -> bool:
    """Return whether a file of an sdist holds its metadata."""
    folder, _, name = member.rpartition("/")
    return member == "PKG-INFO" or (folder.endswith(".egg-info") and name in METADATA)


def fetch(artifact: Artifact, target: Path, places: Sequence[str], wanted: Callable[[str], bool]) -> int:
    """Write to `target` a `.tar.gz` with the wanted files of an sdist; return the bytes that were read for it.

    `places` are files, and folders with a slash at their end: nothing after the last of them is read. Paths lack the
    folder that holds everything. Raises IndexUnreachable where the place of the sdist gives no parts of files,
    ValueError where it cannot be read.
    """
    with index.parts(artifact) as read:
        source = _Parts(read)
        try:
            with (
                tarfile.open(fileobj=source, mode="r|gz", bufsize=BLOCK) as sdist,
                tarfile.open(target, "w:gz") as output,
            ):
                _copy(sdist, output, places, wanted)
        except tarfile.TarError as error:
            raise ValueError(str(error)) from None
    return source.place


def _copy(
    sdist: tarfile.TarFile, output: tarfile.TarFile, places: Sequence[str], wanted: Callable[[str], bool]
) -> None:
    """Copy what is wanted, until every place was entered and left."""
    entered: set[str] = set()
    for member in sdist:
        path = member.name.partition("/")[2]
        inside = {place for place in places if (path.startswith(place) if place.endswith("/") else path == place)}
        entered |= inside
        if not inside and len(entered) == len(places):
            return
        content = sdist.extractfile(member) if member.isfile() and wanted(path) else None
        if content is not None:
            output.addfile(member, content)


class _Parts(io.RawIOBase):
    """A file from its beginning to its end, of which parts are fetched as they are read."""

    def __init__(self, read_part: index.ReadPart) -> None:
        self._read_part = read_part
        self._part = io.BytesIO()
        self._size = 1
        self.place = 0

    def read(self, count: int = -1) -> bytes:
        """Return the next bytes, fewer than asked for at the end of a part; none at the end of the file."""
        content = self._part.read(count)
        if not content and self.place < self._size:
            part, self._size = self._read_part(f"{self.place}-{self.place + PART - 1}")
            self.place += len(part)
            self._part = io.BytesIO(part)
            content = self._part.read(count)
        return content

"""Fetch of a wheel the members that matter: its index of files, then those that are asked for."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from harness.model import Artifact
from harness.packages import index

TAIL = 1 << 16
"""Bytes at the end of a wheel that are read first; most wheels have their whole index of files in them."""

GAP = 1 << 18
"""Unwanted bytes between two members that are read along, as one more request takes longer."""

END = struct.Struct("<4s4H2LH")
"""The record at the end of a zip file: its mark, four numbers of disks and members, size and place of the index."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PartialWheel:
    """A wheel on disk that holds only some members: all names of members, and the bytes that were read for it."""

    file: Path
    names: tuple[str, ...]
    downloaded: int

    def extract(self, folder: Path, wanted: Callable[[str], bool]) -> None:
        """Write the wanted members below a folder."""
        with zipfile.ZipFile(self.file) as archive:
            archive.extractall(folder, [name for name in self.names if wanted(name)])


def fetch(artifact: Artifact, file: Path, wanted: Callable[[str], bool]) -> PartialWheel:
    """Write to `file` what is wanted of a wheel; holes stand for the rest.

    Raises IndexUnreachable where the place of the wheel gives no parts of files, ValueError where its index of files
    cannot be read.
    """
    with index.parts(artifact) as read, file.open("wb") as target:
        tail, size = read(f"-{TAIL}")
        target.truncate(size)
        start = size - len(tail)
        directory = _directory(tail)
        downloaded = len(tail)
        _write(target, start, tail)
        if directory < start:
            head, _ = read(f"{directory}-{start - 1}")
            downloaded += len(head)
            _write(target, directory, head)
        target.flush()
        members = _members(file)
        for first, last in _ranges(members, directory, wanted):
            end = min(last, start)
            if first < end:
                content, _ = read(f"{first}-{end - 1}")
                downloaded += len(content)
                _write(target, first, content)
    names = tuple(info.filename for info in members)
    return PartialWheel(file=file, names=names, downloaded=downloaded)


def _write(target: BinaryIO, place: int, content: bytes) -> None:
    target.seek(place)
    target.write(content)


def _directory(tail: bytes) -> int:
    """Return the place of the index of files."""
    place = tail.rfind(b"PK\x05\x06")
    if place < 0:
        message = "no end of a zip file is in it"
        raise ValueError(message)
    return int(END.unpack_from(tail, place)[6])


def _members(file: Path) -> Sequence[zipfile.ZipInfo]:
    try:
        with zipfile.ZipFile(file) as archive:
            return sorted(archive.infolist(), key=lambda info: info.header_offset)
    except zipfile.BadZipFile as error:
        raise ValueError(str(error)) from None


def _ranges(
    members: Sequence[zipfile.ZipInfo], directory: int, wanted: Callable[[str], bool]
) -> Iterator[tuple[int, int]]:
    """Yield the first byte of each run of wanted members, and the first after it."""
    ends = [*(info.header_offset for info in members[1:]), directory]
    runs: list[list[int]] = []
    for info, end in zip(members, ends, strict=True):
        if not wanted(info.filename):
            continue
        if runs and info.header_offset - runs[-1][1] <= GAP:
            runs[-1][1] = end
        else:
            runs.append([info.header_offset, end])
    yield from ((first, last) for first, last in runs)

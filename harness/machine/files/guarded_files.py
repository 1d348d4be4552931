"""Read files that a cell, a cache, a user or another machine left, and trust nothing about them.

A file is read only if it is a regular file. No link is followed at its name, a FIFO or a device never blocks, and no
more than a given number of bytes is read. Whatever else goes wrong, also while decoding, is one error: Unreadable.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Self, TypeVar

from harness.model import decoding
from harness.model.hostile_data import Unreadable, raise_unreadable

T = TypeVar("T")

FLAGS = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
PIECE = 1 << 20
MOST_LOG, MOST_OWN = 64 << 20, 256 << 20
"""Bytes that are read of a log, and of a JSON file that the harness wrote."""


def read(path: str | Path, most: int, *, follow: bool = False) -> bytes:
    """Return the whole content, which is refused where it is longer than `most` bytes. Raises Unreadable."""
    content = _piece(path, 0, most + 1, follow=follow)
    if len(content) > most:
        message = f"it is longer than {most} bytes"
        raise Unreadable(message)
    return content


def head(path: str | Path, most: int, *, follow: bool = False) -> bytes:
    """Return the first `most` bytes. Raises Unreadable."""
    return _piece(path, 0, most, follow=follow)


def read_decoded(path: str | Path, most: int, decode: Callable[[bytes], T], *, follow: bool = False) -> T:
    """Return the whole content, decoded by `decode`. Raises Unreadable, whatever `decode` raises."""
    content = read(path, most, follow=follow)
    with raise_unreadable():
        return decode(content)


def load(path: str | Path, kind: type[T]) -> T | None:
    """Return a JSON file of our own; None if it is absent, damaged, or of an older shape and so of no use."""
    try:
        return read_decoded(path, MOST_OWN, decoding.decoder(kind).decode)
    except Unreadable:
        return None


def text(path: str | Path, most: int, *, follow: bool = False) -> str:
    """Return the whole content, which is UTF-8. Raises Unreadable."""
    return read_decoded(path, most, bytes.decode, follow=follow)


def log_text(path: Path) -> str:
    """Return the beginning of a log as text: a command may have put anything in its place."""
    try:
        return head(path, MOST_LOG).decode("utf-8", "replace")
    except Unreadable:
        return ""


class Folder:
    """A folder held open: its files are found even if its name has been given to something else since."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)

    def __enter__(self) -> Self:
        """Hold it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Let it go."""
        os.close(self._descriptor)

    def names(self, wanted: Callable[[str], object], most: int) -> list[str]:
        """Return the names of its regular files that are wanted, sorted, at most so many of them."""
        matches: list[str] = []
        with suppress(OSError), os.scandir(self._descriptor) as entries:
            for entry in entries:
                if wanted(entry.name) and entry.is_file(follow_symlinks=False):
                    matches.append(entry.name)
                if len(matches) == most:
                    break
        return sorted(matches)

    def head(self, name: str, most: int, start: int = 0) -> bytes:
        """Return the first `most` bytes of a file, counted from `start`. Raises Unreadable."""
        return _piece(_plain(name), start, most, folder=self._descriptor)

    def tail(self, name: str, most: int) -> bytes:
        """Return the last `most` bytes of a file. Raises Unreadable."""
        return _piece(_plain(name), -most, most, folder=self._descriptor)


def _plain(name: str) -> str:
    if "/" in name or name in {"", ".", ".."}:
        message = "it is not a name of a file"
        raise Unreadable(message)
    return name


def _piece(path: str | Path, start: int, most: int, *, follow: bool = False, folder: int | None = None) -> bytes:
    with raise_unreadable():
        descriptor = os.open(path, FLAGS if follow else FLAGS | os.O_NOFOLLOW, dir_fd=folder)
        try:
            return _content(descriptor, start, most)
        finally:
            os.close(descriptor)


def _content(descriptor: int, start: int, most: int) -> bytes:
    about = os.fstat(descriptor)
    if not stat.S_ISREG(about.st_mode):
        message = "it is not a regular file"
        raise Unreadable(message)
    at = start if start >= 0 else max(0, about.st_size + start)
    pieces = []
    while most > 0:
        # The read asks for one byte more than is there: a short piece then shows the end without another read.
        size = min(most, max(about.st_size - at + 1, 1 << 12), PIECE)
        piece = os.pread(descriptor, size, at)
        pieces.append(piece)
        at += len(piece)
        most -= len(piece)
        if len(piece) < size:
            break
    return b"".join(pieces)

"""Shorten a log of any length: keep its beginning, its end, and every traceback and error in between."""

from __future__ import annotations

import re
from typing import Callable, List, NamedTuple, Optional, Sequence

BEFORE, AFTER = 3, 250
"""Lines that belong to a marked one: those before it, and at most so many after it."""

MARKS = (
    b"Traceback (most recent call last)", b"No solution found", b"Fatal Python error", b"CMake Error", b": error: ",
    b"fatal error: ", b"terminate called", b"what():", b"egmentation fault", b"ResolutionImpossible", b"ERROR: ",
    b"Assertion", b"exitcode: -", b"died with <Signals", b"[Error] [",
)  # fmt: skip
"""Of a line that may say why."""

NUMBERS = re.compile(rb"0x[0-9a-fA-F]+|\d+")


class Bounds(NamedTuple):
    """Numbers of bytes to keep: of the beginning, of the end, and between them; `chunk` are read at once."""

    head: int = 256000
    tail: int = 1024000
    middle: int = 1024000
    chunk: int = 1 << 20


USUAL = Bounds()


class Excerpt(NamedTuple):
    """A shortened text, the size of the whole in bytes, and the number of bytes left out."""

    text: str
    size: int
    missing: int


class Keeper:
    """Collects a log piece by piece. Blocks that differ only in numbers are kept once."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
        self.size = 0
        self._head = bytearray()
        self._tail = bytearray()
        self._middle: List[bytes] = []
        self._kept = 0
        self._known: set[bytes] = set()
        self._open: Optional[List[bytes]] = None

    def take(self, piece: bytes) -> None:
        """Take the next piece."""
        self.size += len(piece)
        tail = self.bounds.tail
        room = self.bounds.head - len(self._head)
        if room > 0:
            self._head += piece[:room]
            piece = piece[room:]
        self._tail += piece
        if len(self._tail) > tail + self.bounds.chunk:
            # A progress bar of many megabytes is one line, so there may be no line's end to cut at.
            end = self._tail.rfind(b"\n", 0, len(self._tail) - tail) + 1 or len(self._tail) - tail
            self._pass(bytes(self._tail[:end]))
            del self._tail[:end]

    def _pass(self, piece: bytes) -> None:
        """Search a piece from the middle of the log for blocks to keep."""
        if self._open is None and not any(mark in piece for mark in MARKS):
            return
        lines = piece.splitlines(keepends=True)
        marked = {place for place, line in enumerate(lines) if any(mark in line for mark in MARKS)}
        for place, line in enumerate(lines):
            if self._open is not None:
                self._open.append(line)
                # The blank lines around these words are inside a chain, which has to stay one block.
                inside = _leads_on(lines[place - 1 : place]) or _leads_on(lines[place + 1 : place + 2])
                if (not line.strip() and not inside) or len(self._open) > BEFORE + AFTER:
                    self._close()
            elif place in marked:
                self._open = [b"".join(lines[max(0, place - BEFORE) : place]), line]

    def _close(self) -> None:
        """Keep the open block, unless the same was kept before, whatever lines stood in front of it."""
        opened, self._open = self._open, None
        if opened is None:
            return
        block = b"".join(opened)
        shape = NUMBERS.sub(b"0", b"".join(opened[1:]))
        if shape not in self._known and self._kept + len(block) <= self.bounds.middle:
            self._known.add(shape)
            self._middle.append(block)
            self._kept += len(block)

    def finish(self) -> Excerpt:
        """Return all that is kept, as text. No piece may be taken afterwards."""
        self._close()
        cut = self.size > len(self._head) + len(self._tail)
        middle = b"\n\n".join([b"", *self._middle, b""]) if cut else b""
        whole = bytes(self._head) + middle + bytes(self._tail)
        missing = self.size - len(self._head) - len(self._tail) - self._kept
        return Excerpt(decode(whole), self.size, max(0, missing))


def _leads_on(line: Sequence[bytes]) -> bool:
    """Return whether a line stands between the tracebacks of a chain."""
    return any(one.startswith((b"The above exception", b"During handling")) for one in line)


def read_excerpt(read: Callable[[int], bytes], bounds: Bounds = USUAL) -> Excerpt:
    """Read a stream to its end and return the parts to keep."""
    keeper = Keeper(bounds)
    while True:
        piece = read(bounds.chunk)
        if not piece:
            return keeper.finish()
        keeper.take(piece)


def decode(content: bytes) -> str:
    """Decode bytes that are UTF-8, UTF-16 as PowerShell writes it, or damaged."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", "replace").replace("\x00", "")
    return content.decode("utf-8-sig", "replace").replace("\x00", "")

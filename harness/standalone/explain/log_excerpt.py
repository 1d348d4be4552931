"""Shorten a log of any length: keep its beginning, its end, and every traceback and error in between."""

from __future__ import annotations

import re
from typing import Callable, List, NamedTuple, Optional, Set

BEFORE, AFTER = 3, 250
"""Lines that belong to a marked one: those before it, and at most so many after it."""

MARKS = (
    b"Traceback (most recent call last)", b"No solution found", b"Fatal Python error", b"CMake Error", b": error: ",
    b"fatal error: ", b"terminate called", b"what():", b"egmentation fault", b"ResolutionImpossible", b"ERROR: ",
    b"Assertion", b"exitcode: -", b"died with <Signals", b"[Error] [",
)  # fmt: skip
"""Of a line that may say why."""

CHAIN = (b"The above exception", b"During handling")
"""The beginnings of lines between the tracebacks of a chain."""

LONGEST = 1 << 18
"""Bytes of a block: a progress bar may be one line of many megabytes."""

DIGITS = b"0123456789"
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
        self._known: Set[bytes] = set()
        self._open = b""

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
        """Search a piece from the middle of the log for blocks to keep; one that goes on is left for the next piece."""
        piece, self._open = self._open + piece, b""
        places = {mark: piece.find(mark) for mark in MARKS}
        done = 0
        while True:
            first = min((place for place in places.values() if place >= 0), default=None)
            if first is None:
                return
            start = piece.rfind(b"\n", 0, first) + 1
            end = _end_of_block(piece, start)
            before = _lines_before(piece, start, done)
            if end is None and len(piece) - start < LONGEST:
                self._open = piece[before:]
                return
            done = len(piece) if end is None else end
            self._keep(piece[before:start], piece[start:done])
            places = {
                mark: place if place >= done or place < 0 else piece.find(mark, done) for mark, place in places.items()
            }

    def _keep(self, before: bytes, block: bytes) -> None:
        """Keep a block, unless the same was kept before, whatever lines stood in front of it."""
        size = len(before) + len(block)
        if self._kept + size > self.bounds.middle:
            return
        # To remove digits is quick; what is new without them is looked at for addresses, too.
        bare = block.translate(None, DIGITS)
        if bare in self._known:
            return
        shape = NUMBERS.sub(b"0", block)
        if shape not in self._known:
            self._middle.append(before + block)
            self._kept += size
        self._known.update((bare, shape))

    def finish(self) -> Excerpt:
        """Return all that is kept, as text. No piece may be taken afterwards."""
        self._keep(b"", self._open)
        cut = self.size > len(self._head) + len(self._tail)
        middle = b"\n\n".join([b"", *self._middle, b""]) if cut else b""
        whole = bytes(self._head) + middle + bytes(self._tail)
        missing = self.size - len(self._head) - len(self._tail) - self._kept
        return Excerpt(decode(whole), self.size, max(0, missing))


def _end_of_block(piece: bytes, start: int) -> Optional[int]:
    """Return where the block from a marked line on ends: after a blank line, or many lines; None if it goes on."""
    place, previous = start, b""
    for _ in range(AFTER + 1):
        end = piece.find(b"\n", place)
        if end < 0:
            return None
        line = piece[place:end]
        if not line.strip():
            following = piece[end + 1 : end + 40]
            if not following:
                return None
            # The blank lines around these words are inside a chain, which has to stay one block.
            if not (previous.startswith(CHAIN) or following.startswith(CHAIN)):
                return end + 1
        place, previous = end + 1, line
    return place


def _lines_before(piece: bytes, start: int, done: int) -> int:
    """Return where the few lines before a block begin, after what was kept already."""
    place = start
    for _ in range(BEFORE):
        if place > done:
            place = piece.rfind(b"\n", done, place - 1) + 1 or done
    return place


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

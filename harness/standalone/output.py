"""Guard standard output and error: remove what a terminal would obey, and raise nothing once a reader has gone."""

from __future__ import annotations

import io
import os
import sys
from typing import Any, TextIO

from .control_characters import escape_json, strip_controls


class _Pipe(io.FileIO):
    """Writes into nothing once the reader has gone: `| head -1` is no failure, and changes no exit code.

    What is `dispensable` is written into nothing as soon as it cannot be written: nobody could be told.
    """

    dispensable = False

    def write(self, content: Any) -> int:
        try:
            return int(super().write(content) or 0)
        except OSError as error:
            if not (self.dispensable or isinstance(error, BrokenPipeError)):
                self.dispensable = True  # it is told once, not again when Python ends
                raise
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return len(content)


class _Guarded(io.TextIOWrapper):
    """Removes what a terminal would obey from all text."""

    def write(self, text: str) -> int:
        super().write(strip_controls(text))
        return len(text)

    def write_styled(self, text: str) -> int:
        """Write our own colours and movements."""
        return super().write(text)


class _Styled:
    """The same stream for a library that writes colours around text that was made visible before."""

    def __init__(self, stream: _Guarded) -> None:
        self.write = stream.write_styled
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def guard() -> None:
    """Guard both streams of this process. A stream that was closed by whoever started us writes into nothing."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
        elif os.name != "nt" and type(stream) is io.TextIOWrapper:
            # The type is compared exactly: a stream that is guarded already is a subclass, and stays as it is.
            setattr(sys, name, _guarded(stream))


def _guarded(stream: io.TextIOWrapper) -> TextIO:
    stream.flush()
    raw = _Pipe(stream.fileno(), "wb", closefd=False)
    raw.dispensable = stream is sys.stderr
    return _Guarded(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering or stream is sys.stderr,
        write_through=getattr(stream, "write_through", False),
    )


def style_stream(stream: TextIO) -> TextIO:
    """Return a stream for a library that writes colours of its own."""
    target: Any = _Styled(stream) if isinstance(stream, _Guarded) else stream
    return target  # type: ignore[no-any-return]


def print_json(content: bytes) -> None:
    """Print a JSON document on stdout."""
    text = escape_json(content.decode()).rstrip("\n")
    sys.stdout.write(text + "\n")

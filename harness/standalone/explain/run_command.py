"""Runs the user's command as it would run without us, shows what it writes as it comes, and keeps all of it.

It stays in the caller's own environment, session and process group, with the caller's input, so that Ctrl-C reaches
it; where the caller's output is a terminal, so is the command's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import signal
import subprocess
import time
from typing import Any, BinaryIO, Dict, List, NamedTuple, Optional, Sequence, Tuple

from ..failures.lines import signal_name

PIECE = 65536
QUIET, LONGEST = 0.3, 3.0
"""Seconds without a word, and in all, for which the children of a command that has ended are listened to."""

NOT_FOUND, NOT_RUN = 127, 126
"""What a shell returns for a command that is not there, or cannot be run."""


class CommandExit(NamedTuple):
    """The end of a command: `code` as a shell has it, 128+N for signal N. `trouble` says why it was not started."""

    code: int
    signal: Optional[str] = None
    trouble: Optional[str] = None


class _Stream:
    """One stream from the command to us: the end we read, where we show it, and the end the command writes to."""

    def __init__(self, shown: int) -> None:
        self.shown = shown
        self.broken = False
        self.terminal = os.isatty(shown)
        self.reading, self.given = self._terminal() if self.terminal else os.pipe()

    def _terminal(self) -> Tuple[int, int]:
        import pty  # noqa: PLC0415 - Windows has none
        import termios  # noqa: PLC0415

        reading, given = pty.openpty()
        settings = termios.tcgetattr(given)
        settings[1] &= ~termios.OPOST  # the caller's own terminal does that
        termios.tcsetattr(given, termios.TCSANOW, settings)
        self._resize(reading)
        return reading, given

    def _resize(self, reading: int) -> None:
        import fcntl  # noqa: PLC0415
        import termios  # noqa: PLC0415

        with contextlib.suppress(OSError):
            fcntl.ioctl(reading, termios.TIOCSWINSZ, fcntl.ioctl(self.shown, termios.TIOCGWINSZ, b"\0" * 8))

    def resized(self) -> None:
        """Adopt the new size of the caller's window."""
        if self.terminal:
            self._resize(self.reading)

    def read(self) -> bytes:
        """Return the next piece; an empty one at the end."""
        try:
            return os.read(self.reading, PIECE)
        except OSError as error:
            if error.errno == errno.EIO:  # nobody has the terminal open any more
                return b""
            raise

    def show(self, piece: bytes) -> bool:
        """Show a piece; False where nobody looks any more."""
        while piece:
            try:
                piece = piece[os.write(self.shown, piece) :]
            except BlockingIOError:
                time.sleep(0.01)
            except OSError:
                return False
        return True


def run(argv: Sequence[str], log: BinaryIO, *, apart: bool = False) -> CommandExit:
    """Run a command to its end. `log` is a file that keeps what it writes, both streams in order.

    `apart` sends all that it writes to the caller's stderr, since stdout is for something else.
    """
    streams = _streams(apart=apart)
    with _Signals(streams) as signals:
        try:
            process = subprocess.Popen(list(argv), stdout=streams[0].given, stderr=streams[-1].given)
        except OSError as error:
            code = NOT_FOUND if isinstance(error, FileNotFoundError) else NOT_RUN
            return CommandExit(code, trouble="{}: cannot be run: {}".format(argv[0], error.strerror))
        finally:
            # Our copies have to go: a stream ends only when the last process has closed it.
            for stream in streams:
                os.close(stream.given)
        signals.process = process
        if _copy(streams, log, process):
            _go_on(streams, log)
        code = process.wait()
    if code < 0:
        return CommandExit(128 - code, signal_name(-code))
    return CommandExit(code)


def _streams(*, apart: bool) -> List[_Stream]:
    """Return one stream if both go to one place, so that their order stays; else one for each."""
    out, err = (2, 2) if apart else (1, 2)
    first = _Stream(out)
    return [first] if _same(out, err) else [first, _Stream(err)]


def _same(descriptor: int, other: int) -> bool:
    if descriptor == other:
        return True
    here, there = os.fstat(descriptor), os.fstat(other)
    return (here.st_dev, here.st_ino) == (there.st_dev, there.st_ino)


# --- what is written -------------------------------------------------------------------------------------------


def _copy(streams: Sequence[_Stream], log: BinaryIO, process: Any = None) -> bool:
    """Show and keep what comes until the command and its children have ended; True where some still write.

    Without a process all streams are read to their ends.
    """
    ended: Optional[float] = None
    with selectors.DefaultSelector() as waiting:
        for stream in streams:
            with contextlib.suppress(OSError, ValueError):  # this one has ended
                waiting.register(stream.reading, selectors.EVENT_READ, stream)
        while waiting.get_map():
            # The end of the command is polled, because its children may hold the streams open long after it.
            ready = waiting.select(None if process is None else 0.1 if ended is None else QUIET)
            for key, _ in ready:
                if not _pass_on(key.data, log):
                    waiting.unregister(key.fd)
                    # If our own reader has gone, the command now gets a broken pipe, as it would without us.
                    os.close(key.fd)
            if process is None:
                continue
            if ended is None and process.poll() is not None:
                ended = time.monotonic()
            elif ended is not None and (not ready or time.monotonic() - ended > LONGEST):
                return True
    return False


def _pass_on(stream: _Stream, log: BinaryIO) -> bool:
    """Show and keep the next piece; False at the end, or where nobody looks any more."""
    piece = stream.read()
    log.write(piece)
    # A fork copies what is still in the buffer, and both processes would write it.
    log.flush()
    return bool(piece) and stream.show(piece)


def _go_on(streams: Sequence[_Stream], log: BinaryIO) -> None:
    """Fork a process that passes on the output of children that outlive the command; it ends when they do."""
    if os.fork():
        return
    try:
        _copy(streams, log)
    finally:
        # `sys.exit` would run our caller's `finally` blocks, and write its buffers a second time.
        os._exit(0)


# --- signals ---------------------------------------------------------------------------------------------------


class _Signals:
    """Signal handlers while the command runs: Ctrl-C is left to the command, SIGTERM and SIGHUP are passed on to it."""

    def __init__(self, streams: Sequence[_Stream]) -> None:
        self.streams = streams
        self.process: Any = None
        self.before: Dict[int, Any] = {}

    def __enter__(self) -> _Signals:
        # SIGINT gets a handler that does nothing, not SIG_IGN: the command would inherit that, and miss Ctrl-C.
        for names, handler in (
            (("SIGINT", "SIGQUIT"), self._leave),
            (("SIGTERM", "SIGHUP"), self._forward),
            (("SIGWINCH",), self._resize),
        ):
            for name in names:
                if hasattr(signal, name):
                    self.before[getattr(signal, name)] = signal.signal(getattr(signal, name), handler)
        return self

    def _leave(self, number: int, _: Any) -> None:
        """Do nothing: the terminal has sent the signal to the command, too."""

    def _forward(self, number: int, _: Any) -> None:
        if self.process:
            self.process.send_signal(number)

    def _resize(self, number: int, _: Any) -> None:
        for stream in self.streams:
            stream.resized()

    def __exit__(self, *_: Any) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)

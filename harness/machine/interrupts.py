"""Catch the signals that end a command, from its first line on: each ends it with a sentence and leaves nothing.

Nothing but what Python has loaded by itself is imported here: whatever takes time comes after the handlers.
"""

import os
import signal
import stat

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType

INTERRUPTED, TERMINATED = 130, 143
GOES_ON = "finished results are kept, and the same command continues from there"
ENDING = (signal.SIGTERM, signal.SIGHUP)
"""SIGHUP comes where a terminal is closed, an ssh session ends; `nohup` makes it ignored."""


class Terminated(BaseException):
    """SIGTERM or SIGHUP, raised in the main thread so that `with` blocks end what they started."""


def at_once() -> None:
    """Let a signal end the process with its sentence alone, while nothing is started yet."""
    for number in (*ENDING, signal.SIGINT):
        if signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, _end)


def orderly() -> None:
    """Let a signal, from now on, first end everything that was started."""
    for number in ENDING:
        if signal.getsignal(number) != signal.SIG_IGN or number == signal.SIGTERM:
            signal.signal(number, _raise)
    if signal.getsignal(signal.SIGINT) == _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def sentence(code: int) -> str:
    """Say how a command was ended, and what is left of it."""
    return f"simmatrix: {'interrupted' if code == INTERRUPTED else 'terminated'}; {GOES_ON}"


def _end(number: int, frame: "FrameType | None") -> None:
    code = INTERRUPTED if number == signal.SIGINT else TERMINATED
    _leave_dead_terminal()
    try:
        os.write(2, f"{sentence(code)}\n".encode())
    finally:
        # An exception is no way out here: some modules crash where a signal raises while they are imported.
        os._exit(code)


def _raise(number: int, frame: "FrameType | None") -> None:
    for each in ENDING:  # once is enough: what is being ended is not to be left in the middle
        signal.signal(each, signal.SIG_IGN)
    _leave_dead_terminal()
    raise Terminated


def _leave_dead_terminal() -> None:
    """Write nowhere instead of to a terminal that is gone: every write to it would fail."""
    for stream in (1, 2):
        try:
            gone = stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream)
        except OSError:  # it was closed
            continue
        if gone:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)

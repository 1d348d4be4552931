"""Open a file that a user names, without waiting for ever."""

from __future__ import annotations

import errno
import os
import re
import stat
from typing import BinaryIO

INHERITED = re.compile(r"/dev/(?:stdin|fd/\d+)|/proc/self/fd/\d+")
"""Names that a shell gives to a pipe that it made for this command, as in `<(pip freeze)`."""

NAMED_PIPE = "it is a named pipe, which may never end; give a file, or a pipe of the shell such as <(pip freeze)"
DEVICE = "it is a device, not a file"


def open_file(path: str) -> BinaryIO:
    """Open a regular file, or a pipe of the shell, to read. Raises OSError with a sentence for all else."""
    try:
        # Opening a named pipe would wait for a writer. The kind is checked on the open file, which nobody can swap.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError:  # a null character, or half of a surrogate pair
        raise OSError(errno.EINVAL, "no file can have this name") from None
    try:
        _check(path, os.fstat(descriptor).st_mode)
        if hasattr(os, "O_NONBLOCK"):
            os.set_blocking(descriptor, True)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def _check(path: str, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if stat.S_ISREG(mode) or path == os.devnull:
        return
    if not stat.S_ISFIFO(mode):
        raise OSError(errno.EINVAL, DEVICE)
    if not INHERITED.fullmatch(path):
        raise OSError(errno.EINVAL, NAMED_PIPE)

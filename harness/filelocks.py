"""One process at a time on one thing, also where the file system knows no `flock`."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from filelock import BaseFileLock, FileLock, SoftFileLock

NO_FLOCK = frozenset({errno.ENOSYS, errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP})


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Wait for the lock file, hold it, let it go; the file itself stays."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lock: BaseFileLock = FileLock(path)
    try:
        lock.acquire()
    except OSError as error:
        if error.errno not in NO_FLOCK:
            raise
        _tell(str(path.parent))
        lock = SoftFileLock(path.with_name(f"{path.name}-soft"))
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


@cache
def _tell(folder: str) -> None:
    logging.getLogger("harness").warning(
        "%s is on a file system without flock: lock files are used; after a crash remove those that end in -soft",
        folder,
    )

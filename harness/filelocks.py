"""One process at a time on one thing, also where the file system knows no `flock`."""

from __future__ import annotations

import errno
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from harness import process
from harness.errors import CouldNotTell

NO_FLOCK = frozenset({errno.ENOSYS, errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP})


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Wait for the lock file, hold it, let it go; the file itself stays. Raises CouldNotTell once all is stopped."""
    lock = _acquired(path, wait=True)
    if lock is None:
        message = "Interrupted: nothing is waited for any more."
        raise CouldNotTell(message)
    try:
        yield
    finally:
        lock.release()


class Claim:
    """Several lock files held together, in one thread or another; they go with the claim."""

    def __init__(self, locks: list[BaseFileLock]) -> None:
        self._locks = locks

    def release(self) -> None:
        """Let go. The files are removed while they are held: who waits for one finds that out and makes another."""
        for lock in self._locks:
            Path(lock.lock_file).unlink(missing_ok=True)
            lock.release()


def claim(paths: list[Path], *, wait: bool) -> Claim | None:
    """Hold all of these lock files, or none: None where somebody else holds one, and nobody waits for it."""
    held: list[BaseFileLock] = []
    for path in sorted(paths):
        lock = _acquired(path, wait=wait)
        if lock is None:
            Claim(held).release()
            return None
        held.append(lock)
    return Claim(held)


def _acquired(path: Path, *, wait: bool) -> BaseFileLock | None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lock: BaseFileLock = FileLock(path, thread_local=False)
    patience = -1 if wait else 0
    try:
        try:
            lock.acquire(timeout=patience, cancel_check=process.stopped)
        except OSError as error:
            if isinstance(error, Timeout) or error.errno not in NO_FLOCK:
                raise
            _tell(str(path.parent))
            lock = SoftFileLock(path.with_name(f"{path.name}-soft"), thread_local=False)
            lock.acquire(timeout=patience, cancel_check=process.stopped)
    except Timeout:
        return None
    return lock


@cache
def _tell(folder: str) -> None:
    logging.getLogger("harness").warning(
        "%s is on a file system without flock: lock files are used; after a crash remove those that end in -soft",
        folder,
    )

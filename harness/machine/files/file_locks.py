"""Let one process at a time work on a thing, also where the file system has no `flock`."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from harness.machine import process
from harness.model.errors import CouldNotTell

if TYPE_CHECKING:
    from filelock import BaseFileLock

NO_FLOCK = frozenset({errno.ENOSYS, errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP})


@contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Wait for the lock file, hold it in the block; the file itself stays. Raises CouldNotTell once all is stopped."""
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
    """Hold all of these lock files, or none; return None if somebody holds one of them and nobody waits for it."""
    held: list[BaseFileLock] = []
    # Everybody takes locks in one order, so two processes that wait for several never hold each other up.
    for path in sorted(paths):
        lock = _acquired(path, wait=wait)
        if lock is None:
            Claim(held).release()
            return None
        held.append(lock)
    return Claim(held)


_marks: dict[Path, int] = {}
_marking = threading.Lock()


def mark_used(folder: Path) -> None:
    """Mark a folder as used now, and by this process until it ends; until then `hold_unused` does not grant it.

    The mark is a lock on one byte of a file that all neighbours share, and goes with the process however that ends.
    """
    with suppress(OSError), _marking:  # without such locks a folder is safe while it is young
        marks = folder.parent / "in-use"
        if marks not in _marks:
            folder.parent.mkdir(parents=True, exist_ok=True)
            create_flag = (
                0 if marks.exists() else os.O_CREAT
            )  # which a shared folder may refuse though the file is there
            # The file stays open for good: closing any descriptor of it would drop every mark of this process.
            _marks[marks] = _opened(marks, create_flag)
        fcntl.lockf(_marks[marks], fcntl.LOCK_SH, 1, _byte(folder))
    with suppress(OSError):
        os.utime(folder)


@contextmanager
def alone(folder: Path) -> Iterator[bool]:
    """Keep other processes from using a folder that this process uses.

    Yield False if another process uses it already, or nobody can tell. Processes that come within the block wait for
    its end.
    """
    mark_used(folder)
    descriptor, free = _marks.get(folder.parent / "in-use", -1), False
    # The kernel's lock belongs to the process: `_marking` holds off other threads, whose mark would share it again.
    with _marking:
        with suppress(OSError, ValueError):
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte(folder))
            free = True
        try:
            yield free
        finally:
            if free:
                fcntl.lockf(descriptor, fcntl.LOCK_SH, 1, _byte(folder))


@contextmanager
def hold_unused(folder: Path) -> Iterator[bool | None]:
    """Keep others from using a folder within the block; yield False if somebody uses it, None if nobody can tell.

    Not for a process that uses folders itself: its marks would go.
    """
    try:
        descriptor = os.open(folder.parent / "in-use", os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        yield None
        return
    free: bool | None = True
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte(folder))
    except OSError as error:
        free = None if error.errno in NO_FLOCK else False
    try:
        yield free
    finally:
        os.close(descriptor)


def _opened(marks: Path, create_flag: int) -> int:
    try:
        return os.open(marks, os.O_RDWR | create_flag, 0o666)
    except OSError:  # it is another user's, or the disk takes no write
        return os.open(marks, os.O_RDONLY | create_flag, 0o666)


def _byte(folder: Path) -> int:
    # 60 bits fit into the offset of a lock. The file stays empty: a lock may lie beyond its end.
    return int(sha256(folder.name.encode()).hexdigest()[:15], 16)


def _acquired(path: Path, *, wait: bool) -> BaseFileLock | None:
    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
    from filelock import FileLock, SoftFileLock, Timeout  # noqa: PLC0415 - start-up

    lock: BaseFileLock = FileLock(path, thread_local=False)
    patience = -1 if wait else 0
    try:
        try:
            lock.acquire(timeout=patience, cancel_check=process.is_stopped)
        except OSError as error:
            if isinstance(error, Timeout) or error.errno not in NO_FLOCK:
                raise
            _tell(str(path.parent))
            lock = SoftFileLock(path.with_name(f"{path.name}-soft"), thread_local=False)
            lock.acquire(timeout=patience, cancel_check=process.is_stopped)
    except Timeout:
        return None
    return lock


@cache
def _tell(folder: str) -> None:
    logging.getLogger("harness").warning(
        "%s is on a file system without flock: lock files are used; after a crash remove those that end in -soft",
        folder,
    )

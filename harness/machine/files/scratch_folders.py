"""Make temporary folders, and remove whatever a probe or a build left in them."""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


@contextmanager
def scratch_folder(parent: Path | None = None) -> Iterator[Path]:
    """Make an empty folder that is removed with the block; if its parent was removed meanwhile, make that again."""
    above = parent or Path(tempfile.gettempdir())
    try:
        folder = tempfile.mkdtemp(prefix="simmatrix-", dir=above)
    except FileNotFoundError:
        above.mkdir(parents=True, exist_ok=True)
        folder = tempfile.mkdtemp(prefix="simmatrix-", dir=above)
    try:
        yield Path(folder)
    finally:
        if not remove_folder(Path(folder)):
            logging.getLogger("harness").warning("%s cannot be removed; it is of no use any more", folder)


def remove_folder(path: Path) -> bool:
    """Remove a folder, however deep; tell whether it is gone. No link is followed."""
    with suppress(OSError):
        _empty(os.open(path, FOLDER))
    with suppress(OSError):
        path.rmdir()
    return not os.path.lexists(path)


def _empty(here: int) -> None:
    """Empty a folder, and close it: down by names and up by `..`, so that neither paths nor the stack grow."""
    above: list[tuple[str, tuple[int, int]]] = []
    folders = [_unlinked(here)]
    try:
        while folders[-1] or above:
            if folders[-1]:
                name = folders[-1].pop()
                with suppress(OSError):
                    below = _opened(name, here)
                    above.append((name, _identity(here)))
                    os.close(here)
                    here = below
                    folders.append(_unlinked(here))
                continue
            name, identity = above.pop()
            folders.pop()
            parent = os.open("..", FOLDER, dir_fd=here)
            os.close(here)
            here = parent
            if _identity(here) != identity:
                return  # somebody moves folders meanwhile: nothing outside may be touched
            with suppress(OSError):  # it, or something in it, may not be changed
                os.rmdir(name, dir_fd=here)
    finally:
        os.close(here)


def _opened(name: str, folder: int) -> int:
    # A probe may leave folders without permissions, which an ordinary user could not open.
    os.chmod(name, 0o700, dir_fd=folder)
    return os.open(name, FOLDER, dir_fd=folder)


def _identity(folder: int) -> tuple[int, int]:
    about = os.fstat(folder)
    return about.st_dev, about.st_ino


def _unlinked(folder: int) -> list[str]:
    """Remove the files of a folder; return the names of its folders."""
    kinds: list[tuple[str, bool]] = []
    with suppress(OSError), os.scandir(folder) as entries:
        kinds = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in kinds:
        if not is_folder:
            with suppress(OSError):
                os.unlink(name, dir_fd=folder)
    return [name for name, is_folder in kinds if is_folder]

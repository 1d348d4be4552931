"""Write the site beside its folder, and put it in place as a whole. A folder with other files is refused."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.model.errors import BadInput

MARKER = ".simmatrix-site"
"""The file that lists all files of a site: only these are replaced by the next one."""


def check(out: Path) -> None:
    """Refuse a folder that holds anything but an earlier site. Raises BadInput."""
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        message = f"--out {out}: is no folder; name one that does not exist, or that holds an earlier site"
        raise BadInput(message)
    if not out.exists():
        return
    try:
        listed = set((out / MARKER).read_text(encoding="utf-8").splitlines()) | {MARKER}
    except (OSError, UnicodeDecodeError):
        listed = set()
    others = next((path for path in _files(out) if path not in listed), None)
    if others:
        message = f"--out {out}: holds {others}, which is no part of an earlier site; name another folder"
        raise BadInput(message)


@contextmanager
def replaced(out: Path) -> Iterator[Path]:
    """Give a folder to build in, which takes the place of `out` at the end; an error leaves `out` as it was."""
    target = out.absolute()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except (FileExistsError, NotADirectoryError):
        message = f"--out {out}: {target.parent} is no folder"
        raise BadInput(message) from None
    try:
        new = work / "new"
        new.mkdir()
        yield new
        (new / MARKER).write_text("".join(f"{name}\n" for name in _files(new)), encoding="utf-8")
        if target.exists():
            target.rename(work / "old")
        new.rename(target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _files(folder: Path) -> list[str]:
    """Return the files below a folder; a link counts as a file."""
    paths = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    return sorted(path.relative_to(folder).as_posix() for path in paths)

"""Decide whether resolving a question again would give the lock of an earlier run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from harness.model import Lock, Question
from harness.packages import index_settings

FILE = "file://"


def is_still_valid(lock: Lock, question: Question, locked_at: int) -> bool:
    """Return whether nothing can have changed that the lock, made at this time in nanoseconds, depends on.

    The instant in the question fixes all packages but those that escaped it. These must come from folders of files, and
    all such folders must be as they were.
    """
    if not lock.escaped:
        return True
    links = index_settings.combine(question.index).find_links
    sources = [pin.artifact.source for pin in lock.pins if pin.name in lock.escaped]
    if any("://" in place.removeprefix(FILE) for place in (*links, *sources)):
        return False
    folders = [Path(unquote(link.removeprefix(FILE))) for link in links]
    elsewhere = {Path(unquote(source.removeprefix(FILE))).parent.resolve() for source in sources}
    elsewhere -= {folder.resolve() for folder in folders}
    return not elsewhere and all(changed < locked_at for folder in folders for changed in _changes(folder))


def _changes(folder: Path) -> Iterator[float]:
    """Yield when the folder, its link and its files last changed, in nanoseconds; infinity if it is gone."""
    try:
        # ctime, since a copied file may keep an old mtime; lstat, since the link may lead elsewhere now.
        yield folder.lstat().st_ctime_ns
        yield folder.stat().st_ctime_ns
        for path in folder.iterdir():
            yield path.stat().st_ctime_ns
    except OSError:
        yield float("inf")

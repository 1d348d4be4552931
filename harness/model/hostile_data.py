"""Decode data that a cell, a cache, a user or another machine left: whatever is wrong with them is one error."""

from __future__ import annotations

import errno
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

EXHAUSTED = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOMEM})
"""Errors that say nothing of a file: this process, or the machine, has nothing left."""

DEEPEST = 32
"""Levels of lists and objects that a document may have: what is deeper ends recursive readers."""


class Unreadable(Exception):
    """A file, or its content, is not what it has to be; the text says why, without the file's name."""


class Absent(Unreadable):
    """There is no file of this name."""


@contextmanager
def raise_unreadable() -> Iterator[None]:
    """Turn every error of a reader into Unreadable; that this machine has nothing left stays an OSError."""
    try:
        yield
    except Unreadable:
        raise
    except OSError as error:
        if error.errno in EXHAUSTED:
            raise
        raise _refused(error) from error
    except RecursionError as error:
        message = "it is nested too deeply"
        raise Unreadable(message) from error
    except MemoryError as error:
        message = "it is too large for the memory"
        raise Unreadable(message) from error
    # A decoder may raise anything on hostile data, and all of it means the same: the content is wrong.
    except Exception as error:
        message = " ".join(f"{error}"[:300].split()) or type(error).__name__
        raise Unreadable(message) from error


def _refused(error: OSError) -> Unreadable:
    if error.errno in {errno.ENOENT, errno.ENOTDIR}:
        return Absent("there is no such file")
    return Unreadable("it is a link" if error.errno == errno.ELOOP else error.strerror or str(error))


def shallow(plain: object, deepest: int = DEEPEST) -> bool:
    """Tell whether a decoded document has at most so many levels."""
    level: list[object] = [plain]
    for _ in range(deepest + 1):
        inner: list[object] = []
        for value in level:
            inner += value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
        if not inner:
            return True
        level = inner
    return False


def json_object(line: str | bytes) -> dict[str, Any] | None:
    """Return the JSON object of a line; None where it is cut short, or anything else."""
    try:
        with raise_unreadable():
            plain = json.loads(line)
    except Unreadable:
        return None
    return plain if isinstance(plain, dict) and shallow(plain) else None

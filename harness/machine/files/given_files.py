"""Read and write files that a user names: bounded, without waiting for ever, and each trouble as one sentence."""

from __future__ import annotations

import os
from pathlib import Path

from harness.machine.store import write_atomic
from harness.model.errors import SHORTAGES, BadInput
from harness.standalone.opening import open_file

LARGEST_TEXT = 4 << 20
"""Bytes of a matrix, a requirement file or another text that somebody wrote."""

LARGEST_DOCUMENT = 512 << 20
"""Bytes of a report, which machines write."""


def read_text(path: Path, where: str = "") -> str:
    """Read a UTF-8 text, with or without a byte order mark. Raises BadInput; `where` names the file in messages."""
    try:
        text = read_content(path, where, LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError:
        message = f"{where or path}: is not UTF-8 text"
        raise BadInput(message) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_content(path: Path, where: str = "", largest: int = LARGEST_DOCUMENT) -> bytes:
    """Read a file of at most `largest` bytes. Raises BadInput; `where` names the file in messages."""
    try:
        with open_file(os.fspath(path)) as file:
            content = file.read(largest + 1)
    except OSError as error:
        message = f"{where or path}: cannot be read: {error.strerror}"
        raise BadInput(message) from None
    if len(content) > largest:
        message = f"{where or path}: cannot be read: it has more than {largest >> 20} MB"
        raise BadInput(message)
    return content


def write_text(path: Path, text: str) -> None:
    """Write a text that the user names, as `write_content` does. Raises BadInput."""
    write_content(path, text.encode())


def write_content(path: Path, content: bytes) -> None:
    """Write a file that the user names, whole or not at all; into a pipe or a device as it is. Raises BadInput."""
    try:
        # A rename would put a plain file in the place of a device, even of /dev/null where root writes.
        if path.exists() and not path.is_file():
            with path.open("wb") as file:  # a folder raises here
                file.write(content)
        else:
            write_atomic(path, content)
    except (OSError, ValueError) as error:
        # A full disk is no mistake of the user's: the command line gives it an exit code of its own.
        if isinstance(error, OSError) and error.errno in SHORTAGES:
            raise
        message = f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}"
        raise BadInput(message) from None

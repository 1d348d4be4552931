"""Files that the harness writes: whole or not at all, and only where they change."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from harness.machine.store import write_atomic, write_changed


def test_a_file_that_says_the_same_is_left_alone(tmp_path: Path) -> None:
    """Its inode stays."""
    path = tmp_path / "cell.json"
    write_atomic(path, b"same")
    before = path.stat().st_ino

    write_changed(path, b"same")

    assert path.stat().st_ino == before


@pytest.mark.parametrize("content", [b"same and more", b"sam", b""])
def test_a_file_that_says_something_else_is_replaced(tmp_path: Path, content: bytes) -> None:
    """A file is replaced even if one content begins like the other."""
    path = tmp_path / "cell.json"
    write_atomic(path, b"same")

    write_changed(path, content)

    assert path.read_bytes() == content


def test_a_fifo_is_replaced_without_waiting_for_it(tmp_path: Path) -> None:
    """A FIFO that nobody writes to would block its reader."""
    path = tmp_path / "cell.json"
    os.mkfifo(path)

    write_changed(path, b"record")

    assert path.is_file()
    assert path.read_bytes() == b"record"
    assert [file.name for file in tmp_path.iterdir()] == ["cell.json"]

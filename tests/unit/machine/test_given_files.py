"""Files that a user names: read within bounds, refused with one sentence."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from harness.machine.files import given_files
from harness.model.errors import BadInput
from harness.standalone.opening import DEVICE, NAMED_PIPE


def sentence(path: Path) -> str:
    """Read a file that cannot be read, and return what the user is told."""
    with pytest.raises(BadInput) as raised:
        given_files.read_text(path)
    return str(raised.value)


def test_a_text_has_one_kind_of_line_end_and_no_mark(tmp_path: Path) -> None:
    """A byte order mark and the line ends of other systems are taken away."""
    path = tmp_path / "x"
    path.write_bytes(b"\xef\xbb\xbfone\r\ntwo\rthree\n")
    assert given_files.read_text(path) == "one\ntwo\nthree\n"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("gone", "No such file or directory"),
        (".", "Is a directory"),
        ("x" * 300, "File name too long"),
        ("a\0b", "no file can have this name"),
        ("\ud800", "no file can have this name"),
    ],
)
def test_a_path_that_is_no_file_is_bad_input(tmp_path: Path, name: str, why: str) -> None:
    """Missing files, folders and names that no file can have are one sentence each."""
    path = tmp_path / name
    assert sentence(path) == f"{path}: cannot be read: {why}"


def test_neither_pipes_nor_devices_are_waited_for(tmp_path: Path) -> None:
    """A pipe with a name and a device without an end are refused at once."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert sentence(pipe) == f"{pipe}: cannot be read: {NAMED_PIPE}"
    assert sentence(Path("/dev/zero")) == f"/dev/zero: cannot be read: {DEVICE}"


def test_a_pipe_of_the_shell_is_read() -> None:
    """`<(pip freeze)` names a descriptor that this process was started with."""
    reading, writing = os.pipe()
    os.write(writing, b"numpy==1.0\n")
    os.close(writing)
    assert given_files.read_text(Path(f"/dev/fd/{reading}")) == "numpy==1.0\n"
    os.close(reading)


def test_a_file_that_is_too_long_is_refused(tmp_path: Path) -> None:
    """A sparse file of many gigabytes costs no memory."""
    path = tmp_path / "x"
    with path.open("wb") as file:
        file.truncate(1 << 38)
    assert sentence(path) == f"{path}: cannot be read: it has more than 4 MB"


@pytest.mark.parametrize(
    ("name", "why"),
    [(".", "Is a directory"), ("x" * 300, "File name too long"), ("a\0b", "embedded null byte")],
)
def test_a_file_that_cannot_be_written_is_bad_input(tmp_path: Path, name: str, why: str) -> None:
    """Folders and names that no file can have are one sentence each."""
    with pytest.raises(BadInput) as raised:
        given_files.write_text(tmp_path / name, "x")
    assert str(raised.value) == f"{tmp_path / name}: cannot be written: {why}"


def test_a_device_stays_a_device(tmp_path: Path) -> None:
    """Output goes into a device or a pipe: `--out /dev/null` as root does not replace it by a file."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    given_files.write_text(pipe, "text")
    assert os.read(reader, 10) == b"text"
    assert pipe.is_fifo()

"""Tests the reader of foreign files: regular ones only, up to a size, without following a link or blocking."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.machine.files import guarded_files, scratch_folders
from harness.model import hostile_data
from harness.model.hostile_data import Absent, Unreadable


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


def _link(path: Path) -> None:
    (path.parent / "secret").write_bytes(b"of the user")
    path.symlink_to("secret")


NOT_FILES: list[tuple[Callable[[Path], None], str]] = [
    (lambda _: None, "there is no such file"),
    (os.mkfifo, "it is not a regular file"),
    (lambda path: path.mkdir(), "it is not a regular file"),
    (_loop, "it is a link"),
    (_link, "it is a link"),
    (lambda path: path.symlink_to("/dev/zero"), "it is a link"),
]


@pytest.mark.parametrize(("make", "why"), NOT_FILES)
def test_only_regular_files_are_read(tmp_path: Path, make: Callable[[Path], None], why: str) -> None:
    """A FIFO does not block, a link is not followed, a folder is no file."""
    make(tmp_path / "left")
    readers = (guarded_files.read, guarded_files.head, guarded_files.text)
    for reader in readers:
        with pytest.raises(Unreadable, match=why):
            reader(tmp_path / "left", 100)
    with guarded_files.Folder(tmp_path) as folder:
        assert "left" not in folder.names(lambda _: True, 100)
        with pytest.raises(Unreadable, match=why):
            folder.head("left", 100)
        with pytest.raises(Unreadable, match=why):
            folder.tail("left", 100)


def test_a_link_of_the_user_is_followed_where_allowed(tmp_path: Path) -> None:
    """A file that the user names may be a link."""
    _link(tmp_path / "named")
    assert guarded_files.text(tmp_path / "named", 100, follow=True) == "of the user"


def test_no_more_is_read_than_asked_for(tmp_path: Path) -> None:
    """A sparse file of 200 GB costs nothing."""
    huge = tmp_path / "huge"
    with huge.open("wb") as file:
        file.write(b"first")
        file.truncate(200 << 30)
    with pytest.raises(Unreadable, match="longer than 1000 bytes"):
        guarded_files.read(huge, 1000)
    assert guarded_files.head(huge, 7) == b"first\0\0"
    with guarded_files.Folder(tmp_path) as folder:
        assert folder.tail("huge", 4) == b"\0" * 4
        assert folder.head("huge", 3, start=2) == b"rst"


def test_exactly_the_limit_is_whole(tmp_path: Path) -> None:
    """Content of the longest allowed size, of several pieces and of none, comes back as it is."""
    for size in (0, 1, guarded_files.PIECE, 3 * guarded_files.PIECE + 5):
        content = os.urandom(size)
        (tmp_path / "file").write_bytes(content)
        assert guarded_files.read(tmp_path / "file", size) == content
        assert guarded_files.head(tmp_path / "file", size + 9) == content


def test_a_folder_keeps_its_files_when_its_name_is_taken(tmp_path: Path) -> None:
    """A probe that puts a link in the place of its own folder does not make us read elsewhere."""
    own, other = tmp_path / "own", tmp_path / "other"
    for place in (own, other):
        place.mkdir()
        (place / "reply").write_text(place.name, encoding="utf-8")
    with guarded_files.Folder(own) as folder:
        own.rename(tmp_path / "away")
        own.symlink_to(other)
        assert folder.head("reply", 100) == b"own"
        for name in ("../other/reply", "..", ".", ""):
            with pytest.raises(Unreadable, match="not a name of a file"):
                folder.head(name, 100)
    with pytest.raises(OSError, match=r"Not a directory|Too many levels"), guarded_files.Folder(own):
        pass


def test_names_are_bounded(tmp_path: Path) -> None:
    """Of three thousand files so many are listed as are wanted."""
    for number in range(300):
        (tmp_path / f"{number}.txt").touch()
    (tmp_path / "other").touch()
    with guarded_files.Folder(tmp_path) as folder:
        assert len(folder.names(lambda name: name.endswith(".txt"), 64)) == 64
        assert folder.names(lambda name: name == "other", 64) == ["other"]


BAD: list[tuple[bytes, Callable[[bytes], object], str]] = [
    (b"[" * 100_000, json.loads, "nested too deeply"),
    (b"\xff\xfe\xfd", json.loads, "codec can't decode"),
    (b"9" * 5000, json.loads, "integer string conversion"),
    (b"a\n" + b"x" * 200_000, lambda content: list(csv.reader(content.decode().splitlines())), "field larger than"),
    (b"PK\3\4half", lambda content: zipfile.ZipFile(__import__("io").BytesIO(content)), "not a zip file"),
    (b"", lambda _: [].pop(), "pop from empty list"),
    (b"", lambda _: bytes(1 << 60), "too large for the memory"),
    (b"", lambda _: None.name, "no attribute 'name'"),  # type: ignore[attr-defined]
]


@pytest.mark.parametrize(("content", "decode", "why"), BAD)
def test_every_error_of_a_decoder_is_one_error(
    tmp_path: Path, content: bytes, decode: Callable[[bytes], object], why: str
) -> None:
    """RecursionError, UnicodeDecodeError, MemoryError, csv.Error and all others say that the file is unreadable."""
    (tmp_path / "file").write_bytes(content)
    with pytest.raises(Unreadable, match=why):
        guarded_files.read_decoded(tmp_path / "file", 1 << 20, decode)


def test_a_process_without_descriptors_blames_no_file() -> None:
    """A process that can open nothing any more says nothing of the file."""
    with pytest.raises(OSError, match="Too many"), hostile_data.raise_unreadable():
        raise OSError(errno.EMFILE, "Too many open files")
    with pytest.raises(Absent), hostile_data.raise_unreadable():
        raise FileNotFoundError(errno.ENOENT, "No such file")


def test_interrupts_are_no_fault_of_a_file() -> None:
    """Ctrl-C while a file is decoded is not taken for damage."""
    with pytest.raises(KeyboardInterrupt), hostile_data.raise_unreadable():
        raise KeyboardInterrupt


def test_depth_is_bounded() -> None:
    """Data too deep for recursive readers are refused before they are read."""
    plain: object = 1
    for _ in range(hostile_data.DEEPEST):
        plain = {"a": [plain]} if _ % 2 else (plain,)
    assert hostile_data.shallow([1, {"a": {"b": [2]}}])
    assert not hostile_data.shallow(plain)
    assert hostile_data.json_object(b'{"a": [1]}') == {"a": [1]}
    for line in (b"[" * 10_000, b'{"a":' * 500 + b"1" + b"}" * 500, b"[1]", b"\xff", b'{"a"', b""):
        assert hostile_data.json_object(line) is None


class TestRemoval:
    """Removal of everything that a probe can leave."""

    def test_deep_folders(self, tmp_path: Path) -> None:
        """Five thousand nested folders, whose path no call takes any more, go without recursion."""
        top = tmp_path / "top"
        top.mkdir()
        here = os.open(top, os.O_RDONLY)
        for _ in range(5000):
            os.mkdir("folder", dir_fd=here)
            below = os.open("folder", os.O_RDONLY, dir_fd=here)
            os.close(here)
            here = below
        os.close(os.open("file", os.O_CREAT | os.O_WRONLY, dir_fd=here))
        os.close(here)
        assert scratch_folders.remove_folder(top)
        assert not top.exists()

    def test_links_are_not_followed(self, tmp_path: Path) -> None:
        """The target of a link stays."""
        (tmp_path / "kept").mkdir()
        (tmp_path / "kept" / "file").touch()
        (tmp_path / "top" / "inner").mkdir(parents=True)
        (tmp_path / "top" / "inner" / "link").symlink_to(tmp_path / "kept")
        (tmp_path / "top" / "link").symlink_to(tmp_path / "kept")
        assert scratch_folders.remove_folder(tmp_path / "top")
        assert (tmp_path / "kept" / "file").exists()

    def test_locked_folders(self, tmp_path: Path) -> None:
        """Folders without any permission go."""
        (tmp_path / "top" / "inner" / "more").mkdir(parents=True)
        (tmp_path / "top" / "inner" / "more" / "file").touch()
        (tmp_path / "top" / "inner" / "more").chmod(0)
        (tmp_path / "top" / "inner").chmod(0)
        assert scratch_folders.remove_folder(tmp_path / "top")

    def test_odd_things(self, tmp_path: Path) -> None:
        """FIFOs and names that are no text go; what is not there is gone."""
        (tmp_path / "top").mkdir()
        os.mkfifo(tmp_path / "top" / "fifo")
        (tmp_path / "top" / os.fsdecode(b"\xff\n\x1b[31m")).touch()
        assert scratch_folders.remove_folder(tmp_path / "top")
        assert scratch_folders.remove_folder(tmp_path / "top")

    def test_a_folder_that_cannot_be_removed_is_reported(
        self, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        """A folder that somebody is mounted on, or that is immutable, stays, and one line says so."""
        if sys.platform == "linux":
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(os, "unlink", _refusing)
                with scratch_folders.scratch_folder(tmp_path) as made:
                    (made / "file").touch()
        assert [record.message for record in caplog.records] == [f"{made} cannot be removed; it is of no use any more"]

    def test_a_folder_for_temporary_files_that_is_gone_is_made_again(self, tmp_path: Path) -> None:
        """A cleaner that takes TMPDIR away ends no run."""
        parent = tmp_path / "tmp"
        parent.mkdir()
        shutil.rmtree(parent)
        with scratch_folders.scratch_folder(parent) as made:
            assert made.parent == parent
        assert not made.exists()


def _refusing(*_: object, **__: object) -> None:
    raise PermissionError(errno.EPERM, "Operation not permitted")


def test_a_log_that_became_something_else_is_empty(tmp_path: Path) -> None:
    """A command that puts a FIFO in the place of its log holds nobody up."""
    os.mkfifo(tmp_path / "log")
    assert guarded_files.log_text(tmp_path / "log") == ""
    (tmp_path / "text").write_bytes(b"caf\xe9\n")
    assert guarded_files.log_text(tmp_path / "text") == "caf\ufffd\n"

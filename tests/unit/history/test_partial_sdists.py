"""An sdist is read until the places that matter have passed."""

from __future__ import annotations

import io
import random
import tarfile
from pathlib import Path

import pytest

from harness.history import partial_sdists
from harness.model import Artifact

PLACES = ("PKG-INFO", "setup.py", "code/toy.c", "code/python/")

LARGE = 1 << 18
"""Bytes of a file of noise, which does not get smaller."""

MEMBERS = {
    "PKG-INFO": b"Name: toy\n",
    "setup.py": b"setup()\n",
    "code/other.c": b"int other;\n",
    "code/python/toy/__init__.py": b"first = 1\n",
    "code/python/toy/data.bin": random.Random(0).randbytes(LARGE),
    "code/python/toy.egg-info/requires.txt": b"numpy\n",
    "code/toy.c": b"int toy;\n",
    "src/large.cpp": random.Random(1).randbytes(LARGE),
    "src/last.py": b"last = 1\n",
}


def sdist(folder: Path, *, without: str = "") -> Artifact:
    """Return an sdist with large files within and after what matters."""
    file = folder / "toy-1.0.tar.gz"
    with tarfile.open(file, "w:gz") as archive:
        for name, content in MEMBERS.items():
            if name != without:
                member = tarfile.TarInfo(f"toy-1.0/{name}")
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
    return Artifact(filename=file.name, sha256="0" * 64, source=str(file))


def wanted(member: str) -> bool:
    """Return whether a file is wanted: sources and metadata."""
    return member.endswith((".py", "toy.c")) or partial_sdists.is_metadata(member)


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read little at once."""
    monkeypatch.setattr(partial_sdists, "PART", 1 << 14)


def contents(file: Path) -> dict[str, bytes]:
    """Return the files of an archive."""
    with tarfile.open(file) as archive:
        return {member.name: extracted.read() for member in archive if (extracted := archive.extractfile(member))}


def test_nothing_is_read_after_the_last_place(tmp_path: Path) -> None:
    """Files that are wanted are copied as they are; a large file after all places stays where it is."""
    artifact, target = sdist(tmp_path), tmp_path / "kept.tar.gz"
    downloaded = partial_sdists.fetch(artifact, target, PLACES, wanted)
    kept = [name for name in MEMBERS if wanted(name) and not name.startswith("src/")]
    assert contents(target) == {f"toy-1.0/{name}": MEMBERS[name] for name in kept}
    assert "code/python/toy.egg-info/requires.txt" in kept
    assert LARGE < downloaded < LARGE * 1.5


def test_an_sdist_that_lacks_a_place_is_read_to_its_end(tmp_path: Path) -> None:
    """The place could still come, so that all of the file is read, once."""
    artifact, target = sdist(tmp_path, without="code/toy.c"), tmp_path / "kept.tar.gz"
    downloaded = partial_sdists.fetch(artifact, target, PLACES, wanted)
    assert "toy-1.0/src/last.py" in contents(target)
    assert downloaded == Path(artifact.source).stat().st_size


@pytest.mark.parametrize("content", [b"not found" * 20000, b""])
def test_a_file_that_is_no_sdist_is_refused(tmp_path: Path, content: bytes) -> None:
    """A page of an error, say, instead of the file."""
    (tmp_path / "page").write_bytes(content)
    artifact = Artifact(filename="toy-1.0.tar.gz", sha256="0" * 64, source=str(tmp_path / "page"))
    with pytest.raises(ValueError, match=r"\w"):
        partial_sdists.fetch(artifact, tmp_path / "kept.tar.gz", PLACES, wanted)


def test_an_sdist_that_breaks_off_is_refused(tmp_path: Path) -> None:
    """The rest of its names would seem to be gone."""
    artifact = sdist(tmp_path)
    file = Path(artifact.source)
    file.write_bytes(file.read_bytes()[: LARGE // 2])
    with pytest.raises(ValueError, match="unexpected end of data"):
        partial_sdists.fetch(artifact, tmp_path / "kept.tar.gz", PLACES, wanted)

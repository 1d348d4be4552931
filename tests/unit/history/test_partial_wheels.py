"""A wheel is read in parts: its index of files, and the members that are asked for."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from harness.history import partial_wheels, release_reader
from harness.model import Artifact

LARGE = partial_wheels.GAP * 3
"""Bytes of a member that is not read along with its neighbours."""


def wheel(folder: Path, *, modules: int = 1) -> Artifact:
    """Return a wheel with a large library between small sources."""
    file = folder / "toy-1.0-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("toy/__init__.py", "first = 1\n")
        archive.writestr("toy/core.so", bytes(LARGE))
        for number in range(modules):
            archive.writestr(f"toy/module_{number}.py", f"number = {number}\n")
        archive.writestr("toy-1.0.dist-info/METADATA", "Name: toy\nRequires-Dist: numpy<2\n")
    return Artifact(filename=file.name, sha256="0" * 64, source=str(file))


def test_only_what_is_wanted_is_read(tmp_path: Path) -> None:
    """All names are told; a large member that is not wanted stays where it is."""
    partial = partial_wheels.fetch(wheel(tmp_path), tmp_path / "part", release_reader.is_source)
    partial.extract(tmp_path / "toy", release_reader.is_source)
    assert "toy/core.so" in partial.names
    assert sorted(path.name for path in (tmp_path / "toy").rglob("*.*")) == ["__init__.py", "module_0.py"]
    assert (tmp_path / "toy" / "toy" / "module_0.py").read_text() == "number = 0\n"
    assert partial.downloaded < LARGE


def test_a_long_index_of_files_is_read_whole(tmp_path: Path) -> None:
    """The index of a wheel with thousands of files does not fit into what is read first."""
    partial = partial_wheels.fetch(wheel(tmp_path, modules=2000), tmp_path / "part", release_reader.is_metadata)
    partial.extract(tmp_path / "toy", release_reader.is_metadata)
    facts = release_reader.read_listing(tmp_path / "toy", files=partial.names)
    assert len(facts.modules) == 2002
    assert facts.requires == ("numpy<2",)
    assert facts.names == {}


def test_a_file_that_is_no_wheel_is_refused(tmp_path: Path) -> None:
    """A page of an error, say, instead of the file."""
    (tmp_path / "page").write_bytes(b"not found" * 20000)
    artifact = Artifact(filename="toy-1.0-py3-none-any.whl", sha256="0" * 64, source=str(tmp_path / "page"))
    with pytest.raises(ValueError, match="no end of a zip file"):
        partial_wheels.fetch(artifact, tmp_path / "part", release_reader.is_source)

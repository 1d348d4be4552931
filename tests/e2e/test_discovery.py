"""Where Pythons lie, found anew exactly when something came or went."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.machine import python_discovery

BASE = Path(sys.base_prefix, "bin", "python{}.{}".format(*sys.version_info)).resolve()


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with one folder on PATH, in which two names lead to one Python."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in set(python_discovery.VARIABLES) - {"PATH", "HOME"}:
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("python3", "python3.77"):
        (folder / name).symlink_to(BASE)
    monkeypatch.setenv("PATH", str(folder))
    assert found(tmp_path) == {BASE}
    return folder


def found(tmp_path: Path) -> set[Path]:
    """What is found besides the Python that runs this."""
    return set(python_discovery.candidates(tmp_path / "managed")[1:])


def executable(path: Path) -> Path:
    """Something that looks like a Python."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


def test_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing changed nobody looks."""
    monkeypatch.setitem(sys.modules, "findpython", None)

    assert found(tmp_path) == {BASE}


def test_broken_memory(tmp_path: Path) -> None:
    """A memory that cannot be read is as good as none."""
    (tmp_path / "cache/candidates.json").write_text("{")

    assert found(tmp_path) == {BASE}


def test_link_that_leads_elsewhere(place: Path, tmp_path: Path) -> None:
    """The folder on PATH is as it was, what a link there leads to is not."""
    middle = tmp_path / "current"
    first, second = (executable(tmp_path / name / "python3.78") for name in ("a", "b"))
    middle.symlink_to(first.parent)
    (place / "python3.78").symlink_to(middle / "python3.78")
    assert found(tmp_path) == {BASE, first}

    middle.unlink()
    middle.symlink_to(second.parent)

    assert found(tmp_path) == {BASE, second}


@pytest.mark.parametrize(
    "name",
    [
        "bin/python3.78",
        "home/.pyenv/versions/3.78.1/bin/python3.78",
        "home/.asdf/installs/python/3.78.1/bin/python3.78",
        "home/.rye/py/cpython@3.78.1/bin/python3",
        "home/.local/share/uv/python/cpython-3.78.1-linux-x86_64-gnu/bin/python3",
        "managed/cpython-3.78.1-linux-x86_64-gnu/bin/python3",
    ],
)
def test_new_one(tmp_path: Path, name: str) -> None:
    """A Python that comes into a folder is found, also one whose folder was there before it, as in a long build."""
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    assert found(tmp_path) == {BASE}

    executable(path)
    assert found(tmp_path) == {BASE, path}

    path.unlink()
    assert found(tmp_path) == {BASE}

"""Find the Pythons of a machine, searching again only if a folder or link has changed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.machine import python_discovery

BASE = Path(sys.base_prefix, "bin", "python{}.{}".format(*sys.version_info)).resolve()


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the only folder on PATH, in which two names lead to one Python."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in set(python_discovery.VARIABLES) - {"PATH", "HOME"}:
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("python3", "python3.77"):
        (folder / name).symlink_to(BASE)
    monkeypatch.setenv("PATH", str(folder))
    assert other_pythons(tmp_path) == {BASE}
    return folder


def other_pythons(tmp_path: Path) -> set[Path]:
    """Return the Pythons found besides the one that runs this test."""
    return set(python_discovery.candidates(tmp_path / "managed")[1:])


def executable(path: Path) -> Path:
    """Write a file that looks like a Python, and return it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


def test_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a change the remembered Pythons are used, and nothing is searched."""
    monkeypatch.setitem(sys.modules, "findpython", None)

    assert other_pythons(tmp_path) == {BASE}


def test_broken_memory(tmp_path: Path) -> None:
    """A damaged memory is ignored."""
    (tmp_path / "cache/candidates.json").write_text("{")

    assert other_pythons(tmp_path) == {BASE}


def test_link_that_leads_elsewhere(place: Path, tmp_path: Path) -> None:
    """A changed target of a link is noticed, though the folder on PATH is unchanged."""
    middle = tmp_path / "current"
    first, second = (executable(tmp_path / name / "python3.78") for name in ("a", "b"))
    middle.symlink_to(first.parent)
    (place / "python3.78").symlink_to(middle / "python3.78")
    assert other_pythons(tmp_path) == {BASE, first}

    middle.unlink()
    middle.symlink_to(second.parent)

    assert other_pythons(tmp_path) == {BASE, second}


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
    """A new Python in a folder is found, also if the folder was there first, as in a long build."""
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    assert other_pythons(tmp_path) == {BASE}

    executable(path)
    assert other_pythons(tmp_path) == {BASE, path}

    path.unlink()
    assert other_pythons(tmp_path) == {BASE}

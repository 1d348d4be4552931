"""Bytecode of an environment: a run's own is discarded, and the kept one is compiled apart from the run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness.packages.environments import bytecode
from harness.packages.environments.bytecode import RunFolders, Source

MODULE = "import os\nSEEN = os.path.basename(__cached__ or '')\n"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Source:
    """Return an environment of one module, and this Python."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "environment"
    (folder / "package").mkdir(parents=True)
    (folder / "package/__init__.py").write_text(MODULE)
    return Source(folders=(folder,), python=Path(sys.executable), cache=tmp_path / "cache/pycache/key")


def imported(lent: RunFolders, folder: Path, more: str = "") -> str:
    """Import the module as a probe does, and return its output."""
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); import package; print(package.SEEN); {more}"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-X", f"pycache_prefix={lent.prefix}", "-c", code],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout + done.stderr


def pyc(lent: RunFolders, folder: Path) -> Path:
    """Return the place in which a run finds the byte code of the module."""
    (found,) = Path(f"{lent.prefix}{folder}/package").glob("__init__.*.pyc")
    return found


def run_twice(source: Source) -> None:
    """Run twice: the second run has the bytecode that the first needed, compiled apart."""
    (folder,) = source.folders
    for _ in range(2):
        with bytecode.lend_folders(source, folder, "t") as lent:
            imported(lent, folder)


def test_byte_code_of_a_run_is_there_for_the_next(source: Source) -> None:
    """The second run finds byte code before it has compiled any, of the standard library, too."""
    (folder,) = source.folders
    with bytecode.lend_folders(source, folder, "t") as lent:
        assert not list(lent.prefix.rglob("*.pyc"))
        imported(lent, folder, "import json")
    with bytecode.lend_folders(source, folder, "t") as lent:
        assert pyc(lent, folder).is_file()
        assert [path for path in lent.prefix.rglob("decoder.*.pyc") if "json" in path.parts]
        before = pyc(lent, folder).stat().st_mtime_ns
        imported(lent, folder)
        assert pyc(lent, folder).stat().st_mtime_ns == before  # it was good as it was
    assert not list(source.cache.glob("simmatrix-*"))


def test_a_copy_of_an_environment_has_it_in_its_own_place(source: Source, tmp_path: Path) -> None:
    """A run that sees the environment elsewhere finds its byte code there."""
    run_twice(source)
    with bytecode.lend_folders(source, tmp_path / "copy", "t") as lent:
        assert pyc(lent, tmp_path / "copy").is_file()


def test_tampered_byte_code_reaches_no_other_run(source: Source) -> None:
    """Poisoned bytecode is deleted with the run that left it, also if it is for a new name."""
    (folder,) = source.folders
    run_twice(source)
    with bytecode.lend_folders(source, folder, "t") as lent:
        good = pyc(lent, folder).read_bytes()
        pyc(lent, folder).write_bytes(good[:16] + b"poison")
        (pyc(lent, folder).parent / "other.cpython-311.pyc").write_bytes(b"poison")
        (Path(f"{lent.prefix}/etc")).mkdir()
        (Path(f"{lent.prefix}/etc/passwd.cpython-311.pyc")).write_bytes(b"poison")
    with bytecode.lend_folders(source, folder, "t") as lent:
        assert pyc(lent, folder).read_bytes() == good
        assert not [path for path in lent.prefix.rglob("*.pyc") if b"poison" in path.read_bytes()]
        assert not list(lent.prefix.glob("etc/*"))


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "fifo", "folder", "deep"])
def test_damage_is_not_used(source: Source, damage: str) -> None:
    """However the file is damaged, a run compiles again, and the next run finds it whole."""
    (folder,) = source.folders
    run_twice(source)
    code = source.cache / bytecode.CODE
    content = code.read_bytes()
    code.unlink()
    match damage:
        case "fifo":
            os.mkfifo(code)
        case "folder":
            code.mkdir()
        case _:
            broken = {"cut": content[:-9], "flipped": content[:-9] + b"\xff" * 9, "deep": b"[" * 100_000, "empty": b""}
            code.write_bytes(broken[damage])
    with bytecode.lend_folders(source, folder, "t") as lent:
        assert imported(lent, folder).startswith("__init__.")
        assert b"\xff" * 9 not in pyc(lent, folder).read_bytes()


def test_fresh_runs_compile_code_again(source: Source) -> None:
    """`--fresh` and `--verify` use no bytecode of earlier runs."""
    run_twice(source)
    bytecode.forget(source.cache)
    assert not (source.cache / bytecode.CODE).exists()
    run_twice(source)
    assert (source.cache / bytecode.CODE).exists()


def test_a_source_that_cannot_be_compiled_is_asked_for_once(source: Source) -> None:
    """A module that has a syntax error or was deleted is skipped without harm."""
    (folder,) = source.folders
    (folder / "package/broken.py").write_text("def (\n")
    with bytecode.lend_folders(source, folder, "t") as lent:
        imported(lent, folder)
        (pyc(lent, folder).parent / "broken.cpython-311.pyc").write_bytes(b"x")
    for _ in range(2):
        with bytecode.lend_folders(source, folder, "t") as lent:
            assert imported(lent, folder).startswith("__init__.")
            assert not list(lent.prefix.rglob("broken.*"))

"""Bytecode of an environment: a run's own is discarded, and the kept one is compiled apart from the run."""

from __future__ import annotations

import json
import os
import py_compile
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from supervised import missing

from harness.machine import process
from harness.model import replace
from harness.packages.environments import bytecode, bytecode_tree, first_sources
from harness.packages.environments.bytecode import RunFolders, Source
from harness.packages.environments.bytecode_tree import TABLE, read_tree

MODULE = "import os\nSEEN = os.path.basename(__cached__ or '')\n"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Source:
    """Return an environment of one module, and this Python."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(bytecode, "WORTH", 1)
    (tmp_path / "first.txt").touch()
    monkeypatch.setattr(first_sources, "FILE", tmp_path / "first.txt")
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


@pytest.fixture
def interpreter(tmp_path: Path) -> Path:
    """Return a copy of this Python, to whose library something can be added."""
    real = Path(sys.executable).resolve()
    library = Path(os.__file__).parent
    copy, there = tmp_path / "python/bin" / real.name, tmp_path / "python/lib" / library.name
    there.mkdir(parents=True)
    copy.parent.mkdir()
    shutil.copy(real, copy)
    for path in library.iterdir():
        if path.name not in {"os.py", "__pycache__"}:
            (there / path.name).symlink_to(path)
    shutil.copy(library / "os.py", there)  # its place is that of the library
    command = (copy, "-I", "-S", "-c", "import json, os; print(os.__file__)")
    told = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    if told.strip() != str(there / "os.py"):
        pytest.skip("unavailable: a Python that runs in another folder")
    return copy


def kept_module(library: Path, name: str, made_of: str) -> Path:
    """Write a module into a library, and byte code beside it that was made of another text; return the byte code."""
    module = library / f"{name}.py"
    module.write_text(made_of)
    os.utime(module, (1_700_000_000, 1_700_000_000))
    kept = Path(py_compile.compile(str(module)) or "")
    module.write_text("SAID = 'source'\n" + "#" * (len(made_of) - len("SAID = 'source'\n")))
    os.utime(module, (1_700_000_000, 1_700_000_000))
    return kept


@pytest.mark.parametrize("sandbox", ["pid+overlay", "subreaper"])
def test_the_library_has_the_byte_code_of_its_interpreter(
    source: Source, interpreter: Path, monkeypatch: pytest.MonkeyPatch, sandbox: str
) -> None:
    """Byte code beside a library is linked, if it is of that source and no run can have written it."""
    if missing(sandbox):
        pytest.skip(f"unavailable: {sandbox}")
    monkeypatch.setenv(process.FORCED, sandbox)
    library = interpreter.parents[1] / "lib" / Path(os.__file__).parent.name
    made_of = "SAID = 'byte code'\n" + "#" * 100
    fresh, stale = (kept_module(library, name, made_of) for name in ("fresh", "stale"))
    os.utime(library / "stale.py", (1_800_000_000, 1_800_000_000))
    source = replace(source, python=interpreter)
    source.cache.mkdir(parents=True)
    names = [str(library / f"{name}.py") for name in ("fresh", "stale")]
    (source.cache / "names").write_text(json.dumps(names))
    bytecode.compile_ahead(source)
    tree = read_tree(source.cache)
    assert tree
    linked, compiled = (tree.folder / tree.files[name].path for name in names)
    sealed = sandbox != "subreaper"
    assert (linked.stat().st_ino == fresh.stat().st_ino) is sealed
    assert (b"byte code" in linked.read_bytes(), b"byte code" in compiled.read_bytes()) == (sealed, False)
    assert b"byte code" in stale.read_bytes()
    assert library in bytecode.shielded(interpreter)


def test_a_first_run_of_a_listed_package_has_it(source: Source) -> None:
    """Sources that runs of a package needed elsewhere are compiled before the first run here."""
    (folder,) = source.folders
    library = folder / first_sources.libraries(source.python.resolve())[1] / "site-packages"
    for name in ("listed", "other"):
        (library / name).mkdir(parents=True)
        (library / name / "__init__.py").write_text(MODULE)
    lines = (
        "[absent]",
        "packages/other/__init__.py",
        "[listed]",
        "packages/listed/__init__.py",
        "standard/json/decoder.py",
    )
    first_sources.FILE.write_text("\n".join((*lines, "packages/listed/gone.py")))
    with bytecode.lend_folders(source, folder, "t") as lent:
        code = sorted(path.name.partition(".")[0] for path in lent.prefix.rglob("*.pyc"))
        assert code == ["__init__", "decoder"]
        assert [path.parent.name for path in lent.prefix.rglob("__init__.*.pyc")] == ["listed"]


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
    """However the table is damaged, a run compiles again, and the next run finds it whole."""
    (folder,) = source.folders
    run_twice(source)
    code = source.cache / TABLE
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


def test_verified_runs_compile_code_again(source: Source) -> None:
    """`--verify` uses nothing that earlier runs compiled; `--fresh` only what was compiled apart from them."""
    run_twice(source)
    (source.cache / "compiled/t/numba").mkdir(parents=True)
    bytecode.forget_compiled(source.cache)
    assert (source.cache / TABLE).exists()
    assert not (source.cache / "compiled").exists()
    bytecode.forget(source.cache)
    assert not (source.cache / TABLE).exists()
    run_twice(source)
    assert (source.cache / TABLE).exists()


def sibling(source: Source, name: str) -> Source:
    """Return another environment of the same Python, still empty."""
    folder = source.folders[0].parent / name
    (folder / "package").mkdir(parents=True)
    return Source(folders=(folder,), python=source.python, cache=source.cache.parent / name)


def test_the_same_file_in_another_environment_is_compiled_once(source: Source) -> None:
    """An environment that shares a file with another one begins with its byte code."""
    run_twice(source)
    other = sibling(source, "linked")
    (other.folders[0] / "package/__init__.py").hardlink_to(source.folders[0] / "package/__init__.py")
    with bytecode.lend_folders(other, other.folders[0], "t") as lent:
        before = pyc(lent, other.folders[0]).stat().st_mtime_ns
        assert imported(lent, other.folders[0]).startswith("__init__.")
        assert pyc(lent, other.folders[0]).stat().st_mtime_ns == before


def test_another_file_of_the_same_look_is_not_taken_for_it(source: Source) -> None:
    """A file of the same name, size and time has its own byte code, not that of the other environment."""
    run_twice(source)
    other = sibling(source, "forged")
    original, forged = (one.folders[0] / "package/__init__.py" for one in (source, other))
    forged.write_text(MODULE.replace("SEEN = ", "SEEN = 1 and ")[: len(MODULE)].ljust(len(MODULE)))
    times = original.stat()
    os.utime(forged, ns=(times.st_atime_ns, times.st_mtime_ns))
    with bytecode.lend_folders(other, other.folders[0], "t") as lent:
        assert not list(lent.prefix.rglob("package/*.pyc"))


def test_a_first_run_finds_code_of_what_others_needed(source: Source, tmp_path: Path) -> None:
    """The first run in another environment finds its own byte code of what runs elsewhere needed, if it is there."""
    run_twice(source)
    folder = tmp_path / "another"
    (folder / "package").mkdir(parents=True)
    (folder / "package/__init__.py").write_text(MODULE + "OTHER = 1\n")
    another = Source(folders=(folder,), python=source.python, cache=source.cache.parent / "another")
    with bytecode.lend_folders(another, folder, "t") as lent:
        before = pyc(lent, folder).stat().st_mtime_ns
        imported(lent, folder, "print(package.OTHER)")
        assert pyc(lent, folder).stat().st_mtime_ns == before
    (folder / "package/__init__.py").unlink()
    lacking = Source(folders=(folder,), python=source.python, cache=source.cache.parent / "lacking")
    with bytecode.lend_folders(lacking, folder, "t") as lent:
        assert not [path for path in lent.prefix.rglob("*.pyc") if "package" in path.parts]


def test_our_own_files_are_kept_while_they_are_the_same(source: Source, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files that run in a cell are compiled once, and again after they were changed."""
    own = source.folders[0].parent / "own"
    own.mkdir()
    module = own / "ours.py"
    module.write_text("ONE = 1\n")
    monkeypatch.setattr(bytecode, "OWN", f"{own}/")
    (folder,) = source.folders
    seen = []
    for text in ("", "", "TWO = 2\n", ""):
        module.write_text(module.read_text() + text)
        with bytecode.lend_folders(source, folder, "t") as lent:
            seen.append(len(list(Path(f"{lent.prefix}{own}").glob("ours.*.pyc"))))
            imported(lent, folder, f"sys.path.insert(0, {str(own)!r}); import ours")
    assert seen == [0, 1, 1, 1]


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


def test_a_run_that_covers_its_byte_code_shares_it(source: Source) -> None:
    """A run that covers its byte code has the kept folder, which later runs share; what it compiles is for the next."""
    (folder,) = source.folders
    (folder / "package/more.py").write_text("SEEN = 1\n")
    with bytecode.lend_folders(source, folder, "t", covered=True) as lent:
        assert not lent.covered  # there is none to be covered yet
        imported(lent, folder)
    with bytecode.lend_folders(source, folder, "t", covered=True) as lent:
        assert lent.covered
        assert lent.prefix not in lent.writable
        place = pyc(lent, folder)
        assert place.is_file()
    compiled = f"{folder}/package/more.cpython-311.pyc"
    bytecode.note(source, [compiled])
    with bytecode.lend_folders(source, folder, "t", covered=True) as grown:
        assert grown.prefix != lent.prefix  # a run may still have a layer over that one
        assert (grown.prefix / compiled.lstrip("/")).is_file()
        assert pyc(grown, folder).samefile(place)
    with bytecode.lend_folders(source, folder, "t", covered=True) as last:
        assert last.prefix == grown.prefix


@pytest.mark.parametrize("same_boot", [True, False])
def test_a_damaged_file_is_lent_to_nobody(source: Source, monkeypatch: pytest.MonkeyPatch, same_boot: bool) -> None:
    """A file that was changed is compiled anew; after another start also one that looks as it did."""
    (folder,) = source.folders
    run_twice(source)
    tree = read_tree(source.cache)
    assert tree
    damaged = tree.folder / tree.files["package/__init__.py"].path
    before, content = damaged.stat(), damaged.read_bytes()
    damaged.write_bytes(bytes(len(content)))
    if not same_boot:
        os.utime(damaged, ns=(before.st_atime_ns, before.st_mtime_ns))
        monkeypatch.setattr(bytecode_tree, "boot_id", lambda: "another")
    for _ in range(2):
        with bytecode.lend_folders(source, folder, "t", covered=True) as lent:
            assert lent.prefix != tree.folder
            assert pyc(lent, folder).read_bytes() == content


def test_a_replaced_folder_goes_a_day_later(source: Source) -> None:
    """A folder that was replaced stays for a day after that, for runs that have it, and then goes; others stay."""
    (folder,) = source.folders
    run_twice(source)
    first = read_tree(source.cache)
    assert first
    day_ago = time.time() - bytecode_tree.DAY - 60
    os.utime(first.folder, (day_ago, day_ago))
    (folder / "package/more.py").write_text("SEEN = 1\n")
    bytecode.note(source, [f"{folder}/package/more.cpython-311.pyc"])
    for _ in range(2):
        with bytecode.lend_folders(source, folder, "t", covered=True) as lent:
            assert lent.prefix != first.folder
        assert first.folder.exists()
        os.utime(lent.prefix, (day_ago, day_ago))
    os.utime(first.folder, (day_ago, day_ago))
    with bytecode.lend_folders(source, folder, "t", covered=True) as lent:
        assert not first.folder.exists()
        assert pyc(lent, folder).is_file()

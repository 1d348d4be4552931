"""Source trees of a package under test: their state, and the content of their copies."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.model import Subject
from harness.model.errors import BadInput, CouldNotTell
from harness.packages import package_under_test
from harness.packages.sources import checkouts

pytestmark = pytest.mark.usefixtures("workplace")

Git = Callable[..., str]


@pytest.fixture
def git() -> Git:
    """Run git in a folder."""
    found = shutil.which("git")
    if not found:
        pytest.skip("missing library: git")

    def run(folder: Path, *arguments: str) -> str:
        identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "init.defaultBranch=main")
        done = subprocess.run((found, "-C", folder, *identity, *arguments), check=True, capture_output=True, text=True)
        return done.stdout.strip()

    return run


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A project with leftovers of builds and environments, below a repository's folder `whole`."""
    texts = {
        "own/__init__.py": "",
        "setup.py": "",
        "build/lib/own/old.py": "",
        "own.egg-info/PKG-INFO": "",
        "env/pyvenv.cfg": "",
        "env/lib/more.py": "",
        "state/.gitignore": "*\n",
        "state/result": "",
        "own/__pycache__/a.pyc": "",
        "own/build/kept.py": "",
    }
    folder = tmp_path / "whole" / "part"
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    (folder / "link").symlink_to("setup.py")
    return folder


def files_of(folder: Path) -> list[str]:
    """Return the files of a copy, without its history."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir() or path.is_symlink()]
    return sorted(path.as_posix() for path in paths if ".git" not in path.parts)


def test_folder_without_version_control(tree: Path, tmp_path: Path) -> None:
    """The state of a folder is that of its files; leftovers of tools are neither in it nor in a copy."""
    before = checkouts.of_folder(tree)
    (tree / "build" / "lib" / "own" / "old.py").write_text("another")
    same = checkouts.of_folder(tree)
    copy = checkouts.copy_folder(tree, tmp_path / "copy")
    (tree / "own" / "__init__.py").write_text("another")

    assert (before.commit, before.changed) == (None, False)
    assert same == before
    assert checkouts.of_folder(tree).mark != before.mark
    assert files_of(copy) == ["link", "own/__init__.py", "own/build/kept.py", "setup.py"]
    assert (copy / "link").readlink() == Path("setup.py")


def test_checkout(tree: Path, tmp_path: Path, git: Git) -> None:
    """A checkout's state is its commit and whether files differ from it.

    A copy has all files that are not ignored, and the history, as they are there.
    """
    whole = tree.parent
    (whole / ".gitignore").write_text("/part/build\n*.egg-info\nenv\n__pycache__\n")
    git(whole, "init")
    git(whole, "add", "-A")
    git(whole, "commit", "-m", "one")
    clean = checkouts.of_folder(tree)
    git(whole, "tag", "v1.0", "-m", "one", "-a")
    tagged = checkouts.of_folder(tree)
    (tree / "env" / "more").write_text("ignored")
    ignored = checkouts.of_folder(tree)
    (tree / "new.py").write_text("untracked")
    untracked = checkouts.of_folder(tree)
    (tree / "new.py").write_text("untracked, and another")
    (tree / "setup.py").unlink()
    copy = checkouts.copy_folder(tree, tmp_path / "copy")

    assert (clean.commit, clean.changed) == (git(whole, "rev-parse", "HEAD"), False)
    assert tagged.mark != clean.mark
    assert ignored == tagged
    assert untracked.changed
    assert len({clean.mark, tagged.mark, untracked.mark, checkouts.of_folder(tree).mark}) == 4
    assert copy == tmp_path / "copy" / "part"
    assert files_of(tmp_path / "copy") == [
        ".gitignore",
        "part/link",
        "part/new.py",
        "part/own/__init__.py",
        "part/own/build/kept.py",
    ]
    assert git(copy, "describe") == "v1.0"
    assert git(copy, "status", "--short") == "D setup.py\n?? new.py"


def test_leftovers_that_git_does_not_ignore(tree: Path, tmp_path: Path, git: Git) -> None:
    """Leftovers of builds are neither in the state nor in a copy, where a build would find deleted source files."""
    whole = tree.parent
    git(whole, "init")
    git(whole, "add", "part/own/__init__.py", "part/setup.py", "part/env/lib/more.py")
    git(whole, "commit", "-m", "one")
    (tree / "link").unlink()
    (tree / "build" / "lib" / "own" / "old.py").write_text("left by a build")
    copy = checkouts.copy_folder(tree, tmp_path / "copy")

    assert files_of(copy) == ["env/lib/more.py", "own/__init__.py", "own/build/kept.py", "setup.py"]
    shutil.rmtree(tree / "own" / "build")
    assert not checkouts.of_folder(tree).changed


def test_checkout_within_a_checkout(tree: Path, tmp_path: Path, git: Git) -> None:
    """A change inside a submodule changes the state; a copy has the submodule's files without ignored ones."""
    whole, other = tree.parent, tmp_path / "other"
    other.mkdir()
    (other / ".gitignore").write_text("*.o\n")
    (other / "data.py").write_text("1")
    for folder in (other, whole):
        git(folder, "init")
        git(folder, "add", "-A")
        git(folder, "commit", "-m", "one")
    git(whole, "-c", "protocol.file.allow=always", "submodule", "add", str(other), "part/own/vendored")
    git(whole, "commit", "-a", "-m", "two")
    clean = checkouts.of_folder(tree)
    inner = tree / "own" / "vendored"
    (inner / "left.o").write_text("left by a build")
    ignored = checkouts.of_folder(tree)
    (inner / "data.py").write_text("2")
    changed = checkouts.of_folder(tree)
    (inner / "data.py").write_text("3")
    again = checkouts.of_folder(tree)
    copy = checkouts.copy_folder(tree, tmp_path / "copy")

    assert ignored == clean
    assert (changed.changed, len({clean.mark, changed.mark, again.mark})) == (True, 3)
    assert files_of(copy / "own" / "vendored") == [".gitignore", "data.py"]
    assert (copy / "own" / "vendored" / "data.py").read_text() == "3"


def test_files_that_git_does_not_check_are_copied(tree: Path, git: Git) -> None:
    """Files that git does not check for changes are copied as they are, so their content is part of the state."""
    whole = tree.parent
    git(whole, "init")
    git(whole, "add", "-A")
    git(whole, "commit", "-m", "one")
    git(whole, "update-index", "--assume-unchanged", "part/setup.py")
    git(whole, "update-index", "--skip-worktree", "part/own/__init__.py")
    before = checkouts.of_folder(tree)
    (tree / "setup.py").write_text("1")
    assumed = checkouts.of_folder(tree)
    (tree / "own" / "__init__.py").write_text("1")

    assert len({before.mark, assumed.mark, checkouts.of_folder(tree).mark}) == 3


def test_source_that_changes_while_it_is_used(tree: Path, tmp_path: Path) -> None:
    """A source that has changed since the run began cannot be copied: a run uses one state only."""
    settled = package_under_test.record_state(Subject(source=str(tree)))
    package_under_test.copy_source(settled, tmp_path / "same")
    (tree / "setup.py").write_text("another")

    with pytest.raises(CouldNotTell) as error:
        package_under_test.copy_source(settled, tmp_path / "other")

    assert str(error.value) == (
        "subject: its files were changed since this run began, the last of them setup.py; run it again, and write "
        "output elsewhere or to a path that git ignores"
    )


def test_repository(tree: Path, tmp_path: Path, git: Git) -> None:
    """A reference means its present commit; a fetched commit needs no network, another one does."""
    whole = tree.parent
    git(whole, "init")
    git(whole, "add", "-A")
    git(whole, "commit", "-m", "one")
    git(whole, "tag", "v1")
    first = git(whole, "rev-parse", "HEAD")
    source = f"git+file://{whole}@main#subdirectory=part"
    with pytest.raises(CouldNotTell, match="main of the repository was never fetched; run without --offline"):
        checkouts.of_repository(source, offline=True)
    before = checkouts.of_repository(source)
    git(whole, "commit", "--allow-empty", "-m", "two")

    assert (before.commit, before.changed) == (first, False)
    assert checkouts.of_repository(source, offline=True) == before
    assert checkouts.of_repository(source).commit == git(whole, "rev-parse", "HEAD")
    assert checkouts.of_repository(f"git+file://{whole}@v1#subdirectory=part") == before
    assert checkouts.of_repository(f"git+file://{whole}").commit == git(whole, "rev-parse", "HEAD")
    assert checkouts.text(source, first, "setup.py") == checkouts.text(source, first, "absent") == ""
    copy = checkouts.copy_commit(source, first, tmp_path / "copy")
    assert (copy / "own" / "__init__.py").is_file()
    with pytest.raises(BadInput, match=r'the repository has no branch, tag or commit "mian"'):
        checkouts.of_repository(f"git+file://{whole}@mian")
    with pytest.raises(CouldNotTell, match="subject: the repository cannot be fetched: fatal: "):
        checkouts.of_repository(f"git+file://{tmp_path}/nowhere@main")

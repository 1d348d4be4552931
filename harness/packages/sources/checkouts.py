"""Read the state of a package's source tree, a folder or a repository, and make clean copies of it.

Of a git checkout a copy holds what git tracks and what it does not ignore, as it lies there, with the history that
tools read a version from. What tools leave behind never enters, unless git tracks it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import parse_qs, urldefrag, urlsplit

from msgspec import Struct

from harness.machine import process
from harness.machine.files.file_locks import exclusive, mark_used
from harness.machine.store import cache_folder, digest, sha256_of
from harness.model.errors import BadInput, CouldNotTell
from harness.packages import uv_command

REPOSITORY = "git+"
DEADLINE = 600.0
LEFTOVERS = frozenset({".git", ".hg", ".nox", ".tox", ".venv", "__pycache__", "node_modules"})
MARKERS = ("pyvenv.cfg", "CACHEDIR.TAG")
"""Files that mark a folder as an environment or a cache."""

UNWATCHED = {b"S", *(bytes([sign]) for sign in b"abcdefghijklmnopqrstuvwxyz")}
"""Marks of files that git was told not to look at, so that no change of theirs shows in its status."""

# Only the first line may end the script: a checkout may have no commit and no tag, which leaves empty files.
# Without `--no-renames` a renamed file would be an entry of two names.
LOOK = """
git -C "$1" rev-parse --show-toplevel > top || exit 9
git -C "$1" rev-parse --show-prefix > prefix
git -C "$1" rev-parse --verify --quiet HEAD > commit
git -C "$1" describe --tags --long > described 2> /dev/null
git -C "$1" status --porcelain=v1 -z --untracked-files=all --ignore-submodules=none --no-renames > changes
git -C "$(cat top)" ls-files -z -v > tags
"""
CLONE = """
if test -n "$2"; then
    git clone --quiet --shared --no-checkout "$1" tree && git -C tree reset --quiet "$2" || exit 1
fi
"""
LIST = """
git -C "$1" ls-files -z --cached > tracked && git -C "$1" ls-files -z --others --exclude-standard > others
"""
MIRROR = """
if test -d "$1"; then git -C "$1" remote update --prune; else git clone --quiet --mirror "$2" "$1"; fi
"""
SHOW = 'git -C "$1" show "$2:$3" > content'
AT = 'git -C "$1" rev-parse --verify --quiet "$2^{commit}" > commit'
CHECK_OUT = 'git clone --quiet --shared --no-checkout "$1" tree && git -C tree checkout --quiet --detach "$2"'

PASSED_ON = ("HOME", "PATH", "USER", "LANG", "TMPDIR", "SSH_AUTH_SOCK", "XDG_CONFIG_HOME", "GIT_SSH_COMMAND")
# git asks for no password, which nobody could type, and `status` does not write an index into the user's checkout.
FIXED = {
    "GIT_TERMINAL_PROMPT": "0",
    "GIT_OPTIONAL_LOCKS": "0",
    "GIT_CONFIG_COUNT": "1",  # the user names this folder to be built: whose it is, as in a container, does not matter
    "GIT_CONFIG_KEY_0": "safe.directory",
    "GIT_CONFIG_VALUE_0": "*",
}
PROXIES = ("http_proxy", "https_proxy", "all_proxy", "no_proxy")


class State(Struct, frozen=True, kw_only=True):
    """The state of a source tree: a hash of its content, its commit, and whether its files differ from that commit."""

    mark: str
    commit: str | None = None
    changed: bool = False


class Repository(Struct, frozen=True, kw_only=True):
    """A repository as pip writes it: `git+ADDRESS@REFERENCE#subdirectory=FOLDER`."""

    address: str
    reference: str
    subfolder: str

    @classmethod
    def parse(cls, source: str) -> Repository:
        """Take the address apart; without a reference it is the branch that the repository itself names."""
        address, fragment = urldefrag(source.removeprefix(REPOSITORY))
        path = urlsplit(address).path
        reference = path.rpartition("@")[2] if "@" in path else ""
        address = address.removesuffix(f"@{reference}") if reference else address
        subfolder = parse_qs(fragment).get("subdirectory", [""])[0]
        return cls(address=address, reference=reference or "HEAD", subfolder=subfolder)

    @property
    def mirror(self) -> Path:
        """Return the folder of the local mirror."""
        return cache_folder() / "repositories" / digest("repository", self.address)


# --- what state it is in ---------------------------------------------------------------------------------------


def state_of(source: str, *, offline: bool = False) -> State | None:
    """Return the state of a repository, a folder or a file as it is now; None if nothing lies there."""
    if source.startswith(REPOSITORY):
        return of_repository(source, offline=offline)
    if Path(source).is_dir():
        return of_folder(Path(source))
    return State(mark=sha256_of(Path(source))) if Path(source).is_file() else None


def of_folder(folder: Path) -> State:
    """Return the state of a folder, in a git checkout or not."""
    with uv_command.scratch() as work:
        if _git(LOOK, work, str(folder)) is not None:
            files = sorted(_files(folder))
            return State(mark=digest("folder", [(path.as_posix(), _hash(folder / path)) for path in files]))
        top = Path((work / "top").read_text().rstrip("\n"))
        # `described` belongs to the state: tools read a package's version from the nearest tag.
        facts = [(work / name).read_text().strip() for name in ("prefix", "commit", "described")]
        changes, tags = ((work / name).read_bytes().split(b"\0")[:-1] for name in ("changes", "tags"))
    entries = sorted((os.fsdecode(line[3:]), line.startswith(b"??")) for line in changes)
    names = [name for name, untracked in entries if not (untracked and _is_left(top, Path(name), Path(facts[0])))]
    unwatched = sorted(os.fsdecode(line[2:]) for line in tags if line[:1] in UNWATCHED)
    mark = digest("checkout", facts, [(name, _hash(top / name)) for name in (*names, *unwatched)])
    return State(mark=mark, commit=facts[1] or None, changed=bool(names))


def of_repository(source: str, *, offline: bool = False) -> State:
    """Return the state that a reference of a repository points to now.

    Raises CouldNotTell if the repository cannot be fetched, BadInput if it has no such reference.
    """
    wanted = Repository.parse(source)
    mark_used(wanted.mirror)
    # A full hash never comes to mean another commit, so one that was fetched needs no network.
    commit = _commit(wanted) if offline or _is_commit(wanted.reference) else None
    if commit is None and offline:
        message = f"subject: {wanted.reference} of the repository was never fetched; run without --offline"
        raise CouldNotTell(message)
    if commit is None:
        with exclusive(wanted.mirror.with_suffix(".lock")), uv_command.scratch() as work:
            error = _git(MIRROR, work, str(wanted.mirror), wanted.address)
        if error is not None:
            message = f"subject: the repository cannot be fetched: {error}"
            raise CouldNotTell(message)
        commit = _commit(wanted)
    if commit is None:
        message = f'subject: the repository has no branch, tag or commit "{wanted.reference}"'
        raise BadInput(message)
    return State(mark=digest("repository", wanted.address, wanted.subfolder, commit), commit=commit)


def text(source: str, commit: str | None, name: str) -> str:
    """Return the text of a file in a folder, or in a repository at a commit; empty if there is none."""
    if not source.startswith(REPOSITORY):
        path = Path(source, name)
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    wanted = Repository.parse(source)
    with uv_command.scratch() as work:
        _git(SHOW, work, str(wanted.mirror), commit or "", f"{wanted.subfolder}/{name}".lstrip("/"))
        return (work / "content").read_text(encoding="utf-8", errors="replace")


def _commit(wanted: Repository) -> str | None:
    if not wanted.mirror.is_dir():
        return None
    with uv_command.scratch() as work:
        _git(AT, work, str(wanted.mirror), wanted.reference)
        return (work / "commit").read_text().strip() or None


def _is_commit(reference: str) -> bool:
    return len(reference) == 40 and not reference.strip("0123456789abcdef")


# --- clean copies ----------------------------------------------------------------------------------------------


def copy_folder(folder: Path, target: Path) -> Path:
    """Copy a folder, with the whole checkout that it lies in; returns where it lies below the target."""
    target.mkdir(parents=True)
    with uv_command.scratch() as work:
        if _git(LOOK, work, str(folder)) is not None:
            _copy(folder, target, _files(folder))
            return target
        top = Path((work / "top").read_text().rstrip("\n"))
        prefix, commit = ((work / name).read_text().strip() for name in ("prefix", "commit"))
        error = _git(CLONE, work, str(top), commit)
        if error is not None:
            message = f"{folder}: git cannot copy it: {error}"
            raise CouldNotTell(message)
        if commit:
            (work / "tree" / ".git").rename(target / ".git")
    _copy(top, target, _listed(top, Path(prefix)))
    return target / prefix


def copy_commit(source: str, commit: str, target: Path) -> Path:
    """Check out a commit of a repository that was fetched; returns where the package lies below the target."""
    wanted = Repository.parse(source)
    with uv_command.scratch() as work:
        error = _git(CHECK_OUT, work, str(wanted.mirror), commit)
        if error is not None:
            message = f"subject: commit {commit} cannot be checked out: {error}"
            raise CouldNotTell(message)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(work / "tree", target)
    return target / wanted.subfolder


def _copy(folder: Path, target: Path, names: Iterable[Path]) -> None:
    for name in names:
        origin, copy = folder / name, target / name
        if not origin.exists() and not origin.is_symlink():
            continue  # tracked, and deleted
        copy.parent.mkdir(parents=True, exist_ok=True)
        if origin.is_dir() and not origin.is_symlink():
            _copy(origin, copy, _listed(origin) if (origin / ".git").exists() else ())  # a submodule
        else:
            shutil.copy2(origin, copy, follow_symlinks=False)


def _listed(top: Path, below: Path = Path()) -> list[Path]:
    """Return the files of a checkout without leftovers, relative to it; the project lies in its folder `below`."""
    with uv_command.scratch() as work:
        error = _git(LIST, work, str(top))
        if error is not None:
            message = f"{top}: git cannot list it: {error}"
            raise CouldNotTell(message)
        tracked, others = (
            [Path(os.fsdecode(name)) for name in (work / file).read_bytes().split(b"\0")[:-1]]
            for file in ("tracked", "others")
        )
    return tracked + [name for name in others if not _is_left(top, name, below)]


def _is_left(top: Path, name: Path, below: Path) -> bool:
    """Return whether a file of a checkout lies in a folder that a tool left there."""
    return any(_is_leftover(top / folder, at_top=folder.parent == below) for folder in name.parents[:-1])


def _files(folder: Path, below: Path = Path()) -> Iterator[Path]:
    """Yield the files of a folder under no version control, relative to it, without what tools leave behind."""
    for path in sorted((folder / below).iterdir()):
        name = below / path.name
        if path.is_symlink() or not path.is_dir():
            yield name
        elif not _is_leftover(path, at_top=below == Path()):
            yield from _files(folder, name)


def _is_leftover(path: Path, *, at_top: bool) -> bool:
    # A folder that ignores itself belongs to a tool, as our own state folder does (`store.ignored_by_git`).
    # Below the top, `build` and `dist` may be parts of the package.
    ignore = path / ".gitignore"
    return (
        path.name in LEFTOVERS
        or path.name.endswith(".egg-info")
        or (at_top and path.name in {"build", "dist"})
        or any((path / marker).exists() for marker in MARKERS)
        or (ignore.is_file() and ignore.read_bytes().strip() == b"*")
    )


def _hash(path: Path) -> str | None:
    if path.is_symlink():
        return f"-> {path.readlink()}"
    if (path / ".git").exists():
        return of_folder(path).mark  # a submodule, or another checkout
    if not path.is_file():
        return None
    return sha256_of(path) + ("x" if os.access(path, os.X_OK) else "")


def _git(script: str, work: Path, *arguments: str) -> str | None:
    """Run a git script in `work`, where it writes its answers; return None on success, else its error line."""
    given = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
    given |= {name: value for name, value in os.environ.items() if name.lower() in PROXIES}
    given |= FIXED
    completed = process.run(
        process.Command(
            argv=("/bin/sh", "-c", script, "git", *arguments),
            cwd=work,
            env=given,
            limits=process.Limits(seconds=DEADLINE),
            log=work / "git.log",
            profile=process.Profile.HOST,
        )
    )
    if completed.exit_code == 0:
        return None
    lines = (work / "git.log").read_text(encoding="utf-8", errors="replace").split("\n")
    messages = [line.strip() for line in lines if line.strip()]
    fatal = [line for line in messages if line.startswith(("fatal: ", "error: "))]
    return completed.killed or next(iter(fatal or messages[-1:]), f"git ended with {completed.exit_code}")

"""Runs one in-cell probe under the supervisor and watches the limit of each of its checks."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from pathlib import Path
from stat import S_ISLNK
from time import monotonic

import msgspec

from harness import display, outcomes, process, wire
from harness.model import Case, Phase, ProbeReply, ProbeRequest

INCELL = Path(__file__).parent / "incell"
LEADS_ON = "_simmatrix_below.pth"
"""What makes Python look on in the environment below."""

TAKEN_AWAY = "the environment was taken away, or changed, while it was used"
"""What a failure comes to where the environment no longer stands: it says nothing of packages."""

POLL_SECONDS = 0.05
STARTUP_SECONDS = 120.0
LITTLE_ROOM, FEW_NAMES = 1 << 18, 8
MOST_REPLY, MOST_TEXT, MOST_WORKERS, MOST_WRITTEN = 16 << 20, 200_000, 64, 100
"""Bytes that are read of a reply and of another file, and files of workers: what a cell leaves is not trusted."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Site:
    """Where a probe runs: an environment's folder and interpreter, its compile cache, and the cell's own settings.

    `variables` is the whole environment of the probe, `files` maps a path below HOME to its content. `below` is the
    environment that a thin one leads on to. `python_path` are folders, relative to HOME or not, that modules are
    imported from before those of the environment; `brought` maps what the user brought, by a variable's name, to its
    copy. `stands` tells whether the environment is still as it was when it was taken.
    """

    folder: Path
    python: Path
    pycache: Path
    variables: Mapping[str, str]
    files: Mapping[str, bytes]
    below: Path | None = None
    python_path: tuple[str, ...] = ()
    brought: Mapping[str, Path] = field(default_factory=dict)
    stands: Callable[[], bool] = lambda: True

    @property
    def folders(self) -> tuple[Path, ...]:
        """All that a probe runs in, the one that is found first at the end."""
        return (self.below, self.folder) if self.below else (self.folder,)

    def cached(self, home: Path) -> dict[str, str]:
        """The variables of a run, with where Python, numba and Warp keep what they compiled for an environment."""
        kept = {"NUMBA_CACHE_DIR": str(self.pycache / "numba"), "WARP_CACHE_PATH": str(self.pycache / "warp")}
        brought = {name: str(copy) for name, copy in self.brought.items()}
        path = [*(str(home / folder) for folder in self.python_path), *filter(None, [self.variables.get("PYTHONPATH")])]
        found = {"PYTHONPATH": os.pathsep.join(path)} if path else {}
        return {**kept, **self.variables, **brought, **found, "PYTHONPYCACHEPREFIX": str(self.pycache)}


@dataclass(frozen=True, kw_only=True, slots=True)
class ProbeRun:
    """What came of one probe process.

    `overran` is the limit (seconds) that ended it, `replies` where it wrote to, `full` whether that disk is,
    `lost` how the display that it drew on ended.
    """

    reply: ProbeReply
    completed: process.Completed
    overran: float | None
    stacks: str
    replies: Path
    full: bool
    last_lines: str
    memory_mb: int
    places: Mapping[str, str]
    lost: str | None = None

    def ending(self) -> outcomes.Ending:
        """What the end of the process says about the check that was running then."""
        done = self.completed
        overran = STARTUP_SECONDS if done.timed_out else self.overran
        trouble = f"needs more than the {self.memory_mb} MB that its case allows; `memory_mb` of the case raises that"
        return outcomes.Ending(
            exit_code=done.exit_code,
            signal=done.signal,
            overran=overran,
            trouble=trouble if done.out_of_memory else None if overran is not None else done.killed,
            full=self.full,
            lost=self.lost,
            stacks=self.last_lines + self.stacks,
        )

    def printed(self) -> str:
        """What the process printed, as far as its log is kept."""
        log = self.completed.log
        return log.read_bytes()[: 4 << 20].decode("utf-8", "replace") if log.is_file() else ""

    def last_words(self) -> str:
        """The last line that the process printed, or how it ended."""
        lines = self.last_lines.splitlines()
        return lines[-1] if lines else f"exit code {self.completed.exit_code}, signal {self.completed.signal}"


@contextmanager
def probe(site: Site, case: Case, limits: Mapping[str, float]) -> Iterator[ProbeRun]:
    """Run the checks named in `limits` (in their order, each with its seconds) in one process of the cell.

    HOME and the reply are below a folder that goes with the block; its path is short, as sockets below it need.
    """
    scratch = Path(tempfile.mkdtemp(prefix="simmatrix-"))
    try:
        yield _run(site, case, limits, scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _run(site: Site, case: Case, limits: Mapping[str, float], scratch: Path) -> ProbeRun:
    home, replies = scratch / "home", scratch / "reply"
    replies.mkdir(parents=True)
    furnish(site, home)
    allowed = {**limits, **{name: limits[led] for led in limits for name in wire.FOLLOWERS.get(led, ())}}
    folder, sealed = entered(site, scratch)
    request = ProbeRequest(case=case, checks=tuple(limits), folder=str(replies), limits=allowed)
    (scratch / "request.json").write_text(wire.request_to_json(request))
    command = process.Command(
        argv=(
            str(folder / site.python.relative_to(site.folder)),
            "-s",
            str(INCELL / "bootstrap.py"),
            str(scratch / "request.json"),
        ),
        cwd=home,
        env=site.cached(home),
        limits=process.Limits(seconds=STARTUP_SECONDS + sum(allowed.values()), memory_mb=case.memory_mb),
        log=scratch / "log.txt",
        profile=process.Profile.CELL,
        home=home,
        sealed=sealed,
    )
    try:
        with display.shown(command, scratch / "display") as seen:
            completed, overran = _watch(seen.command, replies / "reply.jsonl", allowed)
            lost, places = seen.lost(), seen.places
    except display.NoDisplayError as error:
        completed, overran, lost, places = process.unstarted(command, str(error)), None, None, {}
    completed = watched(site, folder, completed)
    return ProbeRun(
        reply=wire.read_reply(_lines(replies / "reply.jsonl"), _worker_files(replies)),
        completed=completed,
        overran=overran,
        stacks=_text(replies / "stacks.txt"),
        replies=replies,
        full=_full(scratch),
        last_lines=_tail(command.log),
        memory_mb=case.memory_mb,
        lost=lost,
        places={
            **{str(one): "$ENV" for one in site.folders},
            str(folder): "$ENV",
            str(site.pycache): "$PYCACHE",
            str(home): "$HOME",
            str(home / "tmp"): "$TMP",
            str(replies): "$REPLY",
            str(INCELL): "$INCELL",
            str(scratch): "$SCRATCH",
            **{str(copy): f"${name}" for name, copy in site.brought.items()},
            **places,
        },
    )


def _full(folder: Path) -> bool:
    """Whether the disk of a folder has no room left for data, or for names."""
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize < LITTLE_ROOM or (disk.f_files > 0 and disk.f_favail < FEW_NAMES)


def furnish(site: Site, home: Path) -> None:
    """Make a HOME with the cell's own files."""
    (home / "tmp").mkdir(parents=True)
    for name, content in site.files.items():
        target = home / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def entered(site: Site, scratch: Path) -> tuple[Path, tuple[Path, ...]]:
    """The folder of the environment for one run and what is to be sealed of it.

    Where writes cannot be laid over the one of all, that is a copy, in which a thin one and the one below become one.
    """
    if process.OVERLAY in process.sandbox_mode():
        return site.folder, (*site.folders, *site.brought.values())
    target = scratch / "environment"

    def passed_over(at: str, names: list[str]) -> set[str]:
        """What leads on, and links that are there already."""
        here = Path(at)
        there = next(target / here.relative_to(folder) for folder in site.folders if here.is_relative_to(folder))
        return {LEADS_ON} | {name for name in names if (here / name).is_symlink() and (there / name).is_symlink()}

    for folder in site.folders:
        shutil.copytree(folder, target, symlinks=True, dirs_exist_ok=True, ignore=passed_over)
    return target, ()


def watched(site: Site, folder: Path, completed: process.Completed) -> process.Completed:
    """How a run ended, with what it wrote into a copy of its environment, where it had one."""
    if folder == site.folder:
        return completed
    return replace(completed, written=tuple(islice(_differences(site, folder), MOST_WRITTEN)))


def _differences(site: Site, copy: Path) -> Iterator[str]:
    """Files of the copy that are new, changed or gone; compiled bytecode is no change."""
    before = {name: mark for folder in site.folders for name, mark in _files(folder).items()}
    after = _files(copy)
    return (name for name in sorted({*before, *after}) if before.get(name) != after.get(name))


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    found = ((path.relative_to(folder), path.lstat()) for path in folder.rglob("*") if not path.is_dir())
    passed_over = {"__pycache__", LEADS_ON}
    plain = ((name, at) for name, at in found if not passed_over & {*name.parts})
    return {str(name): (at.st_size, 0 if S_ISLNK(at.st_mode) else at.st_mtime_ns) for name, at in plain}


def _watch(command: process.Command, file: Path, limits: Mapping[str, float]) -> tuple[process.Completed, float | None]:
    """Wait for the end, ending the probe when one check, or the end after the last one, takes longer than its limit."""
    follower = _Follower(file)
    with process.start(command) as running:
        since = monotonic()
        while (completed := running.wait(POLL_SECONDS)) is None:
            if follower.advanced():
                since = monotonic()
            limit = limits.get(follower.latest or "", STARTUP_SECONDS)
            if monotonic() - since > limit:
                running.kill(f"limit of {limit:g} s")
                return running.wait(None), limit
        return completed, None


class _Follower:
    """Reads the reply as it grows, to know which check is running; `latest` is the one that started last."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.latest: str | None = None
        self._records = 0
        self._seen = 0

    def advanced(self) -> bool:
        """Whether another check has started or ended since the last call."""
        before = self._records
        try:
            with self.path.open("rb") as file:
                file.seek(self._seen)
                tail = file.read(1 << 20)
        except FileNotFoundError:
            return False
        whole = tail[: tail.rfind(b"\n") + 1]
        self._seen += len(whole)
        for line in whole.splitlines():
            self._take(line)
        return self._records != before

    def _take(self, line: bytes) -> None:
        try:
            record = msgspec.json.decode(line)
        except msgspec.DecodeError:
            return
        if isinstance(record, dict) and record.get("kind") in ("start", "check", "end"):
            self.latest = str(record.get("check", self.latest))
            self._records += 1


def _lines(path: Path) -> Iterator[bytes]:
    """The lines of a file that a cell wrote, as far as they are read at all."""
    yield from _content(path, MOST_REPLY).splitlines(keepends=True)


def _worker_files(folder: Path) -> dict[str, bytes]:
    found = sorted(folder.glob("worker-*"))[:MOST_WORKERS]
    return {path.name: _content(path, MOST_TEXT) for path in found}


def _text(path: Path) -> str:
    return _content(path, MOST_TEXT).decode("utf-8", "replace")


def _tail(log: Path, size: int = 12_000) -> str:
    """The end of our own log, whole lines."""
    text = log.read_bytes()[-size:].decode("utf-8", "replace") if log.is_file() else ""
    return "\n".join([*text.strip().splitlines(), ""])


def _content(path: Path, limit: int) -> bytes:
    """The beginning of a plain file; a cell may have left anything under its name."""
    if path.is_symlink() or not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(limit)


@cache
def file_hash(path: Path) -> str:
    """A hash of one in-cell file that runs by itself."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


@cache
def probe_hash(api: str, phase: Phase) -> str:
    """A hash of exactly the in-cell files that a probe of this phase loads: part of a result's key."""
    names = wire.closure(api, (phase,), lambda name: (INCELL / name).read_text())
    combined = hashlib.sha256()
    for name in names:
        combined.update(name.encode() + b"\0" + (INCELL / name).read_bytes() + b"\0")
    return combined.hexdigest()[:32]

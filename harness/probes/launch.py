"""Run one in-cell probe under the supervisor, and watch the time limit of each of its checks."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from stat import S_ISLNK
from time import monotonic

import msgspec
from msgspec import Struct

from harness.machine import display, process
from harness.machine.files.guarded_files import Folder
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import digest
from harness.model import Case, Phase, ProbeReply, ProbeRequest, decoding, replace
from harness.model.hostile_data import Absent, Unreadable, raise_unreadable
from harness.packages.environments import bytecode
from harness.packages.environments.site_packages import LEADS_ON
from harness.probes import program, wire
from harness.probes.evidence import GIVEN, LOG, REPLY, STACKS, STARTUP_SECONDS

INCELL = Path(__file__).parent.parent / "incell"

POLL_SECONDS = 0.2
"""Seconds between two looks at the check that is running; its end is seen at once."""
LITTLE_ROOM, FEW_NAMES = 1 << 18, 8
MOST_REPLY, MOST_TEXT, MOST_WORKERS, MOST_WRITTEN = 16 << 20, 200_000, 64, 100
"""Bytes that are read of a reply and of another file, and files of workers: what a cell leaves is not trusted."""

MOST_KEPT = 4 << 20
"""Bytes that are kept of each text of a run; of those that are read in part, these."""


class Site(Struct, frozen=True, kw_only=True):
    """The place where a probe runs: an environment and its interpreter, its compile cache, and the cell's own settings.

    `variables` is the whole environment of the probe, `files` maps a path below HOME to its content. `below` is the
    environment that a thin one builds on. `python_path` are folders, relative to HOME or not, from which modules are
    imported before those of the environment. `brought` maps a variable's name to the copy of what the user brought.
    `stands` tells whether the environment is still as it was when it was taken.
    """

    folder: Path
    python: Path
    pycache: Path
    variables: Mapping[str, str]
    files: Mapping[str, bytes]
    below: Path | None = None
    python_path: tuple[str, ...] = ()
    brought: Mapping[str, Path] = {}
    stands: Callable[[], bool] = lambda: True

    @property
    def folders(self) -> tuple[Path, ...]:
        """Return the folders that a probe runs in. Modules are found first in the last one."""
        return (self.below, self.folder) if self.below else (self.folder,)

    @property
    def byte_code(self) -> bytecode.Source:
        """Return where the byte code of the environment is from, and where it is kept."""
        return bytecode.Source(folders=self.folders, python=self.python, cache=self.pycache)

    def run_variables(self, home: Path, code: bytecode.RunFolders) -> dict[str, str]:
        """Return the variables of a run, with the places where Python, numba and Warp keep compiled code."""
        brought = {name: str(copy) for name, copy in self.brought.items()}
        path = [*(str(home / folder) for folder in self.python_path), *filter(None, [self.variables.get("PYTHONPATH")])]
        path_variable = {"PYTHONPATH": os.pathsep.join(path)} if path else {}
        cache_variables = code.variables
        return {
            **cache_variables,
            **self.variables,
            **brought,
            **path_variable,
            # This entry is the last: no variable of a matrix may lead byte code away from the folder of this run.
            bytecode.PREFIX: cache_variables[bytecode.PREFIX],
        }


class Workplace(Struct, frozen=True, kw_only=True):
    """The place of one run: its scratch folder with HOME, and the environment as the run sees it.

    `sealed` are the folders that keep none of what is written to them, `code` are those for compiled code.
    """

    site: Site
    scratch: Path
    folder: Path
    sealed: tuple[Path, ...]
    code: bytecode.RunFolders

    def command(
        self, arguments: Iterable[str], limits: process.Limits, cwd: Path | None = None, **variables: str
    ) -> process.Command:
        """Return the command that runs the environment's Python with these arguments, in HOME if nowhere else."""
        home = self.scratch / "home"
        return process.Command(
            # Without an overlay `folder` is a copy of the environment, whose own interpreter has to run.
            argv=(str(self.folder / self.site.python.relative_to(self.site.folder)), *arguments),
            cwd=cwd or home,
            env={**self.site.run_variables(home, self.code), **variables},
            limits=limits,
            log=self.scratch / LOG,
            profile=process.Profile.CELL,
            home=home,
            sealed=self.sealed,
            byte_code=(self.code.prefix,) if self.code.covered else (),
            shielded=bytecode.shielded(self.site.python),
            writable=(self.scratch, *self.code.writable),
        )


@contextmanager
def set_up(site: Site, scratch: Path, *imports: object) -> Iterator[Workplace]:
    """Make HOME and the environment ready in a scratch folder, for one run that has these imports."""
    _furnish(site, scratch / "home")
    folder, sealed = _prepare_environment(site, scratch)
    with bytecode.lend_folders(site.byte_code, folder, digest(*imports), covered=bool(sealed)) as code:
        yield Workplace(site=site, scratch=scratch, folder=folder, sealed=sealed, code=code)


class ProbeResult(Struct, frozen=True, kw_only=True):
    """The files and results of one probe process, while its folders exist.

    `overran` is the limit (seconds) that ended it, `left` the folder that it wrote its reply to, `beside` the one with
    the log. `full` is true if their disk is full, `lost` says how the display that it drew on ended. `places` maps the
    folders of the run to the names that evidence gives them.
    """

    reply: ProbeReply
    completed: process.Completed
    overran: float | None
    left: Folder
    beside: Folder
    full: bool
    places: Mapping[str, str]
    lost: str | None = None

    def texts(self) -> Iterator[tuple[str, str]]:
        """Yield the name and text of each file that the probe and its workers were to write; nothing else."""
        for name in (LOG, REPLY, STACKS, *_workers(self.left)):
            if text := self.text(name):
                yield name, text

    def text(self, name: str) -> str:
        """Return the beginning of one of these texts, empty where there is none."""
        most = MOST_REPLY if name == REPLY else MOST_KEPT
        return _content(self.beside if name == LOG else self.left, name, most).decode("utf-8", "replace")


@contextmanager
def probe(
    site: Site,
    case: Case,
    limits: Mapping[str, float],
    followers: Iterable[str] | None = None,
    bank: bytes | None = None,
) -> Iterator[ProbeResult]:
    """Run the checks named in `limits` (in their order, each with its seconds) in one process of the cell.

    `followers` are the checks that are to follow them if they pass; all that can if none are named. `bank` is the bank
    of states that it is given.

    HOME and the reply are in a folder that is removed after the block. Its path is short, as sockets below it need.
    """
    with scratch_folder() as scratch:
        (scratch / "reply").mkdir()
        if bank is not None:
            (scratch / "reply" / GIVEN).write_bytes(bank)
        with Folder(scratch) as beside, Folder(scratch / "reply") as left:
            yield _run(site, wire.request(case, limits, scratch / "reply", followers), scratch, beside, left)


def _run(site: Site, request: ProbeRequest, scratch: Path, beside: Folder, left: Folder) -> ProbeResult:
    home, case, allowed = scratch / "home", request.case, request.limits
    (scratch / "request.json").write_text(wire.request_to_json(request))
    with set_up(site, scratch, case.api, case.imports, case.providers, case.beside) as place:
        limits = process.Limits(seconds=STARTUP_SECONDS + sum(allowed.values()), memory_mb=case.memory_mb)
        # -s and not -I, which would ignore the PYTHONPATH of the case.
        command = place.command(("-s", str(INCELL / "bootstrap.py"), str(scratch / "request.json")), limits)
        try:
            with display.open_display(command, scratch / "display") as seen:
                completed, overran = _watch(seen.command, left, allowed)
                lost, places = seen.lost(), seen.places
        except display.NoDisplayError as error:
            completed, overran, lost, places = process.not_started(command, str(error)), None, None, {}
    completed = run_watched(place, completed)
    return ProbeResult(
        reply=_reply(left),
        completed=completed,
        overran=overran,
        left=left,
        beside=beside,
        full=_full(scratch),
        lost=lost,
        places={
            **{str(one): "$ENV" for one in site.folders},
            str(place.folder): "$ENV",
            str(site.pycache): "$PYCACHE",
            **{str(one): "$PYCACHE" for one in (place.code.prefix, *place.code.writable)},
            str(home): "$HOME",
            str(process.temporary(home)): "$TMP",
            str(scratch / "reply"): "$REPLY",
            str(INCELL): "$INCELL",
            str(scratch): "$SCRATCH",
            **{str(copy): f"${name}" for name, copy in site.brought.items()},
            **places,
        },
    )


def _full(folder: Path) -> bool:
    """Return whether the disk of a folder has no room left for data, or for names."""
    try:
        disk = os.statvfs(folder)
    except OSError:  # it was removed
        return False
    return disk.f_bavail * disk.f_frsize < LITTLE_ROOM or (disk.f_files > 0 and disk.f_favail < FEW_NAMES)


def _furnish(site: Site, home: Path) -> None:
    """Make a HOME with the cell's own files."""
    home.mkdir(parents=True)
    for name, content in site.files.items():
        target = home / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _prepare_environment(site: Site, scratch: Path) -> tuple[Path, tuple[Path, ...]]:
    """Return the folder of the environment for one run, and the folders to seal.

    If writes cannot be laid over the shared environment, it is a copy, which merges a thin environment with the one
    below.
    """
    if process.OVERLAY in process.sandbox_mode():
        return site.folder, (*site.folders, *site.brought.values())
    target = scratch / "environment"

    def passed_over(at: str, names: list[str]) -> set[str]:
        """Return the names not to copy: the file that leads on, and links that are there already."""
        here = Path(at)
        there = next(target / here.relative_to(folder) for folder in site.folders if here.is_relative_to(folder))
        # copytree fails where it has to make a link that is already there.
        return {LEADS_ON} | {name for name in names if (here / name).is_symlink() and (there / name).is_symlink()}

    for folder in site.folders:
        shutil.copytree(folder, target, symlinks=True, dirs_exist_ok=True, ignore=passed_over)
    return target, ()


def run_watched(place: Workplace, completed: process.Completed) -> process.Completed:
    """Return how a run ended, with the files that it wrote into its copy of the environment, if it had one.

    What it compiled is noted.
    """
    if place.code.covered:
        bytecode.note(place.site.byte_code, completed.compiled)
    if place.folder == place.site.folder:
        return completed
    return replace(completed, written=tuple(islice(_differences(place.site, place.folder), MOST_WRITTEN)))


def _differences(site: Site, copy: Path) -> Iterator[str]:
    """Yield the files of the copy that are new, changed or gone; compiled bytecode is no change."""
    before = {name: mark for folder in site.folders for name, mark in _files(folder).items()}
    after = _files(copy)
    return (name for name in sorted({*before, *after}) if before.get(name) != after.get(name))


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    marks: dict[str, tuple[int, int]] = {}
    waiting = [""]
    while waiting:  # no recursion: a probe may leave folders of any depth
        inside = waiting.pop()
        with suppress(OSError), os.scandir(folder / inside) as entries:
            for entry in entries:
                name = f"{inside}{entry.name}"
                if entry.name in {"__pycache__", LEADS_ON}:
                    continue
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f"{name}/")
                elif not entry.is_dir():
                    at = entry.stat(follow_symlinks=False)
                    marks[name] = at.st_size, 0 if S_ISLNK(at.st_mode) else at.st_mtime_ns
    return marks


def _watch(
    command: process.Command, left: Folder, limits: Mapping[str, float]
) -> tuple[process.Completed, float | None]:
    """Wait for the end. Kill the probe if a check, or the end after the last one, takes longer than its limit.

    Return also the limit (seconds) that was exceeded, or None.
    """
    follower = _Follower(left)
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


class _Glance(msgspec.Struct, frozen=True):
    """The part of a record that tells which check is running."""

    kind: str
    check: str | None = None


class _Follower:
    """A reader of the growing reply, to know which check is running; `latest` is the one that started last."""

    def __init__(self, left: Folder) -> None:
        self.latest: str | None = None
        self._left = left
        self._records = 0
        self._seen = 0

    def advanced(self) -> bool:
        """Return whether another check has started or ended since the last call."""
        before = self._records
        piece = _content(self._left, REPLY, min(wire.LONGEST_LINE, MOST_REPLY - self._seen), self._seen)
        end = piece.rfind(b"\n") + 1
        if not end and len(piece) == wire.LONGEST_LINE:
            end = len(piece)  # of a line that is none of ours
        self._seen += end
        for line in piece[:end].splitlines():
            self._take(line)
        return self._records != before

    def _take(self, line: bytes) -> None:
        with suppress(Unreadable), raise_unreadable():
            record = decoding.decoder(_Glance).decode(line)
            if record.kind in ("start", "check", "end"):
                self.latest = record.check or self.latest
                self._records += 1


def _reply(left: Folder) -> ProbeReply:
    """Read the reply, up to the most bytes allowed. A file that became something else is a problem."""
    problems: tuple[str, ...] = ()
    content = b""
    try:
        content = left.head(REPLY, MOST_REPLY)
    except Absent:  # the probe has not come that far
        pass
    except Unreadable as error:
        problems = (f"{REPLY}: {error}",)
    workers = {name: _content(left, name, MOST_TEXT) for name in _workers(left)}
    reply = wire.read_reply(content.splitlines(keepends=True), workers)
    return replace(reply, problems=(*problems, *reply.problems))


def _workers(left: Folder) -> list[str]:
    return left.names(wire.WORKER_FILE.fullmatch, MOST_WORKERS)


def _content(folder: Folder, name: str, limit: int, start: int = 0) -> bytes:
    """Return the beginning of a plain file; empty if the cell left anything else under its name."""
    try:
        return folder.head(name, limit, start)
    except Unreadable:
        return b""


@cache
def file_hash(path: Path) -> str:
    """Return a hash of one in-cell file that runs by itself."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


@cache
def probe_hash(api: str, phase: Phase) -> str:
    """Digest what the checks of a phase do with an adapter: part of a result's key."""
    return program.own().phase_digest(api, phase)

"""Run every uv command, build and probe under the supervisor, within limits; it is the only spawner and leaves nothing.

The harness's end, even by SIGKILL, closes the pipe to each supervisor, which ends everything below it. Any Python
can import this module and start a command under it: nothing but the standard library is needed.
"""

from __future__ import annotations

import functools
import io
import marshal
import os
import select
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from time import monotonic
from typing import Any, Self, get_type_hints, overload

from harness.machine import fork_server
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.supervisor import SIZE, tree
from harness.model.errors import BadInput, CouldNotTell
from harness.model.hostile_data import Unreadable, raise_unreadable

SANDBOXES = ("pid+overlay", "pid+readonly", "subreaper+overlay", "subreaper+readonly", "subreaper")
"""Best first: how processes are held together, and how sealed folders are kept from writes."""

OVERLAY = "overlay"
"""Part of the name of a sandbox in which sealed folders can be written to, without keeping any of it."""

UNSEALED = "subreaper"
"""The sandbox in which nothing keeps sealed folders from writes."""

MOST_WRITTEN = 100
FORCED = "HARNESS_SANDBOX"
INTERRUPTED = "interrupted"
"""Why `stop` ends what runs: the user wants it so."""

CONFINING = (
    "/proc/sys/user/max_user_namespaces",
    "/proc/sys/user/max_mnt_namespaces",
    "/proc/sys/user/max_pid_namespaces",
    "/proc/sys/kernel/unprivileged_userns_clone",
    "/proc/sys/kernel/apparmor_restrict_unprivileged_userns",
)
"""Settings of the kernel that forbid namespaces; not every kernel has all."""
STUCK_SECONDS = 20.0  # beyond its deadline a supervisor itself is ended
WAKE_SECONDS = 1.0  # between two wakings of a supervisor that somebody may have stopped


class Profile(StrEnum):
    """The view of this machine that a command has.

    CELL: a HOME, TMPDIR and /dev/shm of its own, no process but its own, sealed folders covered.
    HOST: what the user sees; for our own uv.
    """

    CELL = "cell"
    HOST = "host"


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """The bounds of a command.

    `memory_mb` is for all processes together, shared pages counted once; `output_kb` is kept of the output.
    """

    seconds: float
    memory_mb: int = 6000
    output_kb: int = 2048


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """A command to run, and its bounds. `env` is the whole environment, to which CELL adds HOME, TMPDIR, XDG_*.

    CELL needs `home`, an existing folder; TMPDIR is `tmp` beside it (keep it under 75 characters: multiprocessing
    binds sockets below it, whose addresses end at 107), so that who removes HOME still has it: without one Python
    takes the machine's own. Both go with the folder that they lie in. `sealed` folders can be written to, but keep
    none of it: what was written is reported. So can `byte_code` folders, of which new byte code is reported; they need
    a sandbox with an overlay. `shielded` folders cannot be written to at all, where a mount namespace
    is allowed. `writable` folders below a sealed or shielded one stay as they are, as do `home` and TMPDIR.
    """

    argv: tuple[str, ...]
    cwd: Path
    env: Mapping[str, str]
    limits: Limits
    log: Path
    profile: Profile
    home: Path | None = None
    sealed: tuple[Path, ...] = ()
    byte_code: tuple[Path, ...] = ()
    writable: tuple[Path, ...] = ()
    shielded: tuple[Path, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """The end of a command as its supervisor tells it: `exit_code` or `signal`; both are None if it never ran.

    `killed` is why it was ended, or not run: the reason given to `Running.kill`; `supervisor: ...`; or, with
    `out_of_memory`, that the whole machine had no memory left. None of these says anything about the command.
    `out_of_memory` without `killed` means its own limit. `written` are paths relative to the sealed folder, at most
    100; `compiled` are those of byte code, relative to the folder for it. `stray` counts the processes that outlived
    the command and were ended. `core_seconds` is how long all its processes together had a core. `peak_mb` is the most
    that they held at a look, pages that they share counted for each. `starved` counts the processes of this machine, or
    of our control group, that the kernel ended meanwhile for want of memory. `least_room_mb` is the least room that was
    seen on the disk of `home`.
    """

    exit_code: int | None = None
    signal: int | None = None
    timed_out: bool = False
    out_of_memory: bool = False
    killed: str | None = None
    seconds: float = 0.0
    core_seconds: float = 0.0
    truncated: bool = False
    written: tuple[str, ...] = ()
    compiled: tuple[str, ...] = ()
    stray: int = 0
    peak_mb: int = 0
    starved: int = 0
    least_room_mb: int | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Completed(Report):
    """A command that has ended, or that was never started; `sandbox` is the one that it ran in."""

    argv: tuple[str, ...]
    log: Path
    sandbox: str = ""

    @property
    def shot(self) -> bool:
        """Return whether an unknown sender ended it by SIGKILL: a service or person short of memory, hardly itself."""
        return self.signal == signal.SIGKILL and not (self.killed or self.timed_out or self.out_of_memory)


class Running:
    """A command on its way. Leaving its `with` block ends it; `kill` may come from any thread, the rest from one."""

    def __init__(self, command: Command, sandbox: str) -> None:
        self.command, self.sandbox = command, sandbox
        command.log.parent.mkdir(parents=True, exist_ok=True)
        with command.log.open("wb") as log:
            self._guard = fork_server.Guard(log)
        self._overdue = monotonic() + command.limits.seconds + STUCK_SECONDS
        self._woken = monotonic()
        self._report = b""
        self._completed: Completed | None = None
        self._pipe = threading.Lock()
        order = marshal.dumps(_order(command, sandbox))
        self._tell(len(order).to_bytes(SIZE, "little") + order)

    @property
    def pid(self) -> int:
        """Return the process id of its supervisor."""
        return self._guard.pid

    @property
    def log(self) -> Path:
        """Return the path of its output."""
        return self.command.log

    def poll(self) -> Completed | None:
        """Return how it ended, or None if it still runs."""
        return self.wait(0.0)

    @overload
    def wait(self, timeout: None = None) -> Completed: ...
    @overload
    def wait(self, timeout: float) -> Completed | None: ...
    def wait(self, timeout: float | None = None) -> Completed | None:
        """Wait for its end and return it; None if it still runs after `timeout` seconds."""
        until = float("inf") if timeout is None else monotonic() + timeout
        while self._completed is None:
            now = monotonic()
            self._see_to_supervisor(now)
            if self._readable(max(0.0, min(until, now + WAKE_SECONDS) - now)):
                self._read()
            elif monotonic() >= until:
                break
        return self._completed

    def kill(self, reason: str) -> None:
        """End it: SIGTERM, half a second, SIGKILL."""
        self._overdue = min(self._overdue, monotonic() + STUCK_SECONDS)
        # The keeper reads the reason up to the first line end, so it must have none of its own.
        self._tell(" ".join(reason[:500].split()).encode(errors="replace") + b"\n")

    def __enter__(self) -> Self:
        """Return the command, which is ended with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it, if it has not ended."""
        if self._completed is None:
            self._hang_up()
            self._overdue = min(self._overdue, monotonic() + STUCK_SECONDS)
            self.wait()

    def _tell(self, message: bytes) -> None:
        with self._pipe:
            self._guard.tell(message)

    def _see_to_supervisor(self, now: float) -> None:
        """End a supervisor that is overdue; wake it, in case it was stopped."""
        if now > self._overdue:
            self._guard.signal(signal.SIGKILL)
        elif now - self._woken > WAKE_SECONDS:
            self._woken = now
            self._guard.signal(signal.SIGCONT)

    def _hang_up(self) -> None:
        with self._pipe:
            self._guard.hang_up()

    def _readable(self, patience: float) -> bool:
        poller = select.poll()
        poller.register(self._guard.report, select.POLLIN)
        return bool(poller.poll(patience * 1000))

    def _read(self) -> None:
        data = os.read(self._guard.report, 1 << 16)
        if data:
            self._report += data
            return
        self._hang_up()
        code = self._guard.wait()
        report = _report(self._report) if not code else None
        if report is None:
            _end_orphans(self.command)
            report = Report(killed=f"supervisor: it ended with {code}, without a word")
        end = {field.name: getattr(report, field.name) for field in fields(Report)}
        self._completed = Completed(argv=self.command.argv, log=self.log, sandbox=self.sandbox, **end)
        _live.discard(self)


_live: set[Running] = set()
_gate = threading.Lock()
_stopped = threading.Event()


def get_ready() -> None:
    """Start what forks the supervisor of each command, so that the first one need not wait for it."""
    fork_server.prepare()


def start(command: Command) -> Running:
    """Start a command under the supervisor."""
    sandbox = sandbox_mode() if command.profile is Profile.CELL else "subreaper"
    return _start(command, sandbox)


def run(command: Command) -> Completed:
    """Run a command under the supervisor to its end."""
    with start(command) as running:
        return running.wait()


def not_started(command: Command, reason: str) -> Completed:
    """Return the result of a command that could not even be started; `killed` is the reason."""
    return Completed(argv=command.argv, log=command.log, killed=reason)


def stop() -> None:
    """End every command, whichever thread waits for it, and let nothing start any more."""
    with _gate:
        _stopped.set()
        for running in tuple(_live):
            running.kill(INTERRUPTED)


def is_stopped() -> bool:
    """Return whether `stop` was called: results that come back now say nothing."""
    return _stopped.is_set()


def resident_mb() -> tuple[int, ...]:
    """Return the MB of memory that each running command holds, with all its processes."""
    with _gate:
        roots = [running.pid for running in tuple(_live)]
    everything = tree.processes() if roots else {}
    return tuple(sum(tree.below(root, everything).values()) >> 20 for root in roots)


def sandbox_mode() -> str:
    """Return the best of `SANDBOXES` that this machine allows, found by trying; `HARNESS_SANDBOX` takes another."""
    forced = os.environ.get(FORCED)
    if not forced:
        return _best_sandbox()
    if forced not in SANDBOXES:
        message = f"{FORCED}: there is no {forced!r}; it is one of {', '.join(SANDBOXES)}."
        raise BadInput(message)
    return forced


def confinement() -> list[str]:
    """Return the facts that decide which sandboxes are allowed here; while they stay, so does the best sandbox."""
    names = ("Uid:", "Gid:", "Cap", "NoNewPrivs:", "Seccomp")
    status = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(names)]
    namespaces = [str(Path("/proc/self/ns", name).readlink()) for name in ("user", "pid", "mnt")]
    files = [Path(name) for name in ("/proc/self/attr/current", *CONFINING)]
    # TMPDIR counts: sandboxes are tried in a folder there, and not every file system can hold a layer.
    return [*status, *namespaces, *(_read_text(file) for file in files), f"TMPDIR={os.environ.get('TMPDIR')}"]


def remember(sandbox: str) -> None:
    """Take the sandbox that an earlier process found to be the best, under the same confinement."""
    if sandbox in SANDBOXES:
        _remembered.append(sandbox)


def _start(command: Command, sandbox: str) -> Running:
    with _gate:
        if _stopped.is_set():
            message = "Interrupted: no further command is started."
            raise CouldNotTell(message)
        # The start stays under the gate: `stop` either finds the command among the live ones or refuses it.
        running = Running(command, sandbox)
        _live.add(running)
    return running


def _order(command: Command, sandbox: str) -> dict[str, Any]:
    private = _private(command.home) if command.profile is Profile.CELL else {}
    return {
        "argv": [str(word) for word in command.argv],  # marshal takes plain strings only, no members of enums
        "cwd": str(command.cwd.absolute()),
        "env": {str(name): str(value) for name, value in {**command.env, **private}.items()},
        "seconds": command.limits.seconds,
        "memory_mb": command.limits.memory_mb,
        "output_kb": command.limits.output_kb,
        "sandbox": sandbox,
        "confined": command.profile is Profile.CELL,
        "home": str(command.home and command.home.absolute()),
        # The supervisor compares these paths as text (`sandbox.reopen`), so no link may be left in them.
        "sealed": [str(folder.resolve()) for folder in command.sealed],
        "byte_code": [str(folder.resolve()) for folder in command.byte_code],
        "writable": [str(folder.resolve()) for folder in (*command.writable, *_own(command.home))],
        "shielded": [str(folder.resolve()) for folder in command.shielded],
    }


def _report(text: bytes) -> Report | None:
    """Read the report of a supervisor, if it is one: a command with enough rights may have written into its pipe."""
    stream = io.BytesIO(text)
    try:
        with raise_unreadable():
            report = marshal.load(stream)
    except Unreadable:
        return None
    # Something behind it means that it is not the only one. Every report of ours has a word on `killed`.
    if stream.read(1) or not isinstance(report, dict) or "killed" not in report:
        return None
    kinds, lists = get_type_hints(Report), [report.pop(name, []) for name in ("written", "compiled")]
    fits = all(isinstance(paths, list) and all(isinstance(path, str) for path in paths) for paths in lists)
    fits = fits and all(isinstance(value, kinds.get(name, ())) for name, value in report.items())
    written, compiled = lists
    return Report(**report, written=tuple(written[:MOST_WRITTEN]), compiled=tuple(compiled)) if fits else None


def _end_orphans(command: Command) -> None:
    """Kill the processes that a command left when its supervisor was killed, found by the HOME that is theirs alone.

    In a PID namespace there are none.
    """
    if command.profile is not Profile.CELL or command.home is None:
        return
    mark = os.fsencode(f"HOME={command.home.absolute()}")
    until = monotonic() + STUCK_SECONDS
    while monotonic() < until and (left := list(_having(mark))):
        for pid in left:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)


def _having(variable: bytes) -> Iterator[int]:
    """Yield the processes that were started with a variable, ourselves apart."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if variable in (folder / "environ").read_bytes().split(b"\0") and int(folder.name) != os.getpid():
                yield int(folder.name)


def _private(home: Path | None) -> dict[str, str]:
    if home is None:
        message = "a command of a cell needs a home"
        raise ValueError(message)
    folders = {
        "XDG_CACHE_HOME": ".cache",
        "XDG_CONFIG_HOME": ".config",
        "XDG_DATA_HOME": ".local/share",
        "XDG_STATE_HOME": ".local/state",
        "XDG_RUNTIME_DIR": ".run",
    }
    home = home.absolute()
    for folder in (temporary(home), home / folders["XDG_RUNTIME_DIR"]):  # the others are made by those who use them
        folder.mkdir(mode=0o700, exist_ok=True)
    own = {"HOME": str(home), "TMPDIR": str(temporary(home))}
    return own | {name: str(home / folder) for name, folder in folders.items()}


def temporary(home: Path) -> Path:
    """Return the TMPDIR of a command that has this HOME."""
    return home.with_name("tmp")


def _own(home: Path | None) -> tuple[Path, ...]:
    return () if home is None else (home, temporary(home))


def _read_text(file: Path) -> str:
    try:
        return file.read_text()
    except (OSError, ValueError):
        return ""


_remembered: list[str] = []


@functools.cache
def _best_sandbox() -> str:
    # The last one is taken untried: it keeps no write out of a sealed folder, so `can_seal` would refuse it.
    return (
        _remembered[0]
        if _remembered
        else next(sandbox for sandbox in SANDBOXES if sandbox == SANDBOXES[-1] or can_seal(sandbox))
    )


def can_seal(sandbox: str) -> bool:
    """Return whether a write into a sealed folder stays out of it there, and is seen where there is an overlay."""
    with scratch_folder() as scratch:
        home, sealed = scratch / "home", scratch / "sealed"
        home.mkdir()
        sealed.mkdir()
        command = Command(
            argv=("/bin/sh", "-c", ": > written"),
            cwd=sealed,
            env={},
            limits=Limits(seconds=20),
            log=home / "log",
            profile=Profile.CELL,
            home=home,
            sealed=(sealed,),
        )
        # `start` would ask for the best sandbox, which is only being found out here.
        with _start(command, sandbox) as running:
            done = running.wait()
        seen = done.written == ("written",) if sandbox.endswith("overlay") else done.exit_code not in (None, 0)
        return seen and done.killed is None and not any(sealed.iterdir())

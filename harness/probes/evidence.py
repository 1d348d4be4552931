"""Define the evidence of one probe run: the request, the end of its process, the facts of the host, its files.

These are facts. `harness.judging` works out their meaning, as often as its reading of them gets better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from signal import SIGKILL

from msgspec import Struct

from harness.model import Case, ProbeReply, Suite
from harness.probes import wire

LOG, REPLY, STACKS = "log.txt", "reply.jsonl", "stacks.txt"
JUNIT, MODULES = "junit.xml", "modules.txt"
"""Files of a run: all that it printed, its reply, faulthandler's stacks; of a suite its report and its imports."""

STARTUP_SECONDS = 120.0
"""Seconds that a probe may take to start, and to end after its last check."""

LAST_LINES = 12_000
"""Characters of a log's end in which a process says why it died."""

PICTURE, ARRAYS = ".png", ".npz"
"""Endings of the files of a run that are not text: they are read on demand."""

MOST_ARRAYS = 32 << 20
"""Bytes of a file of arrays; a longer one is refused."""

GIVEN, OUTPUTS, BANK, PIXELS, PLAYED = "given.npz", "outputs.npz", "bank.npz", "pixels.npz", "played.npz"
"""The bank of states that a probe is given, what they led to, a bank that it made, what it drew, and what it played.

See `incell/cell_arrays.py`, `incell/check_behave_pixels.py` and `incell/check_behave_policy.py`.
"""

SHORT_NAME = 16
"""Hexadecimal digits of a run's name in the name of its folder."""


class Request(Struct, frozen=True, kw_only=True):
    """A request to one process: the checks of a case, or the tests of a package.

    `limits` maps a check to its seconds, in the order of the checks; a suite has one of its own. `followers` are checks
    that are to follow those, in the same process. `confirms` marks a run that only tells whether a failure comes again,
    `leads` one whose own checks were asked for only so that others can follow them. `recompiled` marks one before which
    all byte code was thrown away.
    """

    case: Case | None = None
    suite: Suite | None = None
    limits: Mapping[str, float] = {}
    followers: tuple[str, ...] = ()
    confirms: bool = False
    leads: bool = False
    recompiled: bool = False

    @property
    def memory_mb(self) -> int:
        """Return the memory that all its processes may hold together."""
        target = self.case or self.suite
        return target.memory_mb if target else 0


class RunEnd(Struct, frozen=True, kw_only=True):
    """The end of a run's process: `exit_code` or `signal`; neither if it never ran.

    `timed_out` is whether the time for the whole run was over, `overran` the limit of one check (seconds) that was,
    `killed` why the harness ended or did not start it, `out_of_memory` whether it held more than it may. `full` is
    whether its disk had no room left, `lost` how the display ended that it drew on. `written` are files of its
    environment that it wrote to, `stray` counts processes that outlived it. `seconds` is how long it ran, `peak_mb` the
    most that its processes held, `least_room_mb` the least room that was seen on its disk. `sandbox` names the way in
    which it was kept apart.
    """

    exit_code: int | None = None
    signal: int | None = None
    timed_out: bool = False
    overran: float | None = None
    killed: str | None = None
    out_of_memory: bool = False
    full: bool = False
    lost: str | None = None
    written: tuple[str, ...] = ()
    stray: int = 0
    seconds: float = 0.0
    peak_mb: int = 0
    starved: int = 0
    least_room_mb: int | None = None
    sandbox: str = ""

    @property
    def shot(self) -> bool:
        """Tell whether an unknown sender ended it by SIGKILL: a service or a person, hardly itself."""
        return self.signal == SIGKILL and not (self.killed or self.timed_out or self.out_of_memory)


class Host(Struct, frozen=True, kw_only=True):
    """The facts of the host about a run, which no process in the cell could report.

    `python` is the version that the environment was made with, `undrawable` maps a way to draw to why it cannot be used
    here (`explain_undrawable`), `conditions` marks the system. `stood` is whether the environment still was as it was
    installed, `bare_start` why not even Python starts there, where it does not. `shares_memory` is whether there was a
    /dev/shm to write to. `source` is whether a suite's copy of the source could be made, else why not.
    """

    python: str = ""
    undrawable: Mapping[str, str] = {}
    conditions: str | None = None
    stood: bool = True
    bare_start: str | None = None
    shares_memory: bool = True
    source: str | None = None


class ProbeRun(Struct, frozen=True, kw_only=True):
    """One run, kept for ever. `files` maps the name of each file that it left to the SHA-256 of its content.

    `program` is the digest of the in-cell program that ran, check by check. `measured` is the instant of its end (UTC).
    """

    request: Request
    program: Mapping[str, str]
    end: RunEnd
    host: Host
    files: Mapping[str, str]
    measured: str


@dataclass(frozen=True)
class Reading:
    """A run with the texts that it left, which are read as hostile data on demand.

    `name` is the SHA-256 of the run.
    """

    name: str
    run: ProbeRun
    texts: Mapping[str, bytes]

    @cached_property
    def reply(self) -> ProbeReply:
        """Return the reply as far as it can be believed."""
        workers = {name: content for name, content in self.texts.items() if wire.WORKER_FILE.fullmatch(name)}
        return wire.read_reply(self.texts.get(REPLY, b"").splitlines(keepends=True), workers)

    @cached_property
    def printed(self) -> str:
        """Return all that the process printed, as far as it was kept."""
        return self.text(LOG)

    @property
    def last_lines(self) -> str:
        """Return the end of what it printed, whole lines."""
        return "\n".join([*self.printed[-LAST_LINES:].strip().splitlines(), ""])

    @property
    def last_words(self) -> str:
        """Return the last line that the process printed, or how it ended."""
        lines = [line for line in self.last_lines.splitlines() if line != wire.LAST_WORDS]
        end = self.run.end
        return lines[-1] if lines else f"exit code {end.exit_code}, signal {end.signal}"

    @property
    def folder(self) -> str:
        """Return the path of its files, below the folder of the state."""
        return folder_of(self.name)

    def text(self, name: str) -> str:
        """Return the text of a file, empty where there is none."""
        return self.texts.get(name, b"").decode("utf-8", "replace")

    def pictures(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the paths of the frames of these names that could be kept."""
        files = (f"{name.removesuffix('.npy')}{PICTURE}" for name in names)
        return tuple(f"{self.folder}/{name}" for name in files if name in self.run.files)


def folder_of(name: str) -> str:
    """Return the folder in which people find the files of a run, below the folder of the state."""
    return f"evidence/{name[:SHORT_NAME]}"

"""The command line as a user types it: a process of its own in a folder of its own, the network closed."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wheelhouse import FAKES

LONGEST, PATIENCE = 600.0, 60.0
SMALL = Path(__file__).parent / "small.toml"
TOGETHER = ("fake-import-error", "fake-undeclared")
"""Installed beside the environments, since they cost nothing until they are imported."""

APART = {"fake-lamp"}
"""Brings a module `mujoco` of its own, as another fake does."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CommandResult:
    """Exit code, stdout and stderr of a command."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """Return the document that `--json` printed."""
        return dict(json.loads(self.out))

    def cells(self, axis: str) -> dict[str, dict[str, Any]]:
        """Return the cells of the document by their value of an axis."""
        return {cell["axes"][axis]: cell for cell in self.document["cells"] if axis in cell["axes"]}


@dataclass(frozen=True, kw_only=True, slots=True)
class Desk:
    """A working folder with an empty state; the cache and the wheels are shared with the other tests.

    `online` leaves the loopback open, for an index that a test serves.
    """

    folder: Path
    cache: Path
    wheels: Path
    online: bool = False

    @property
    def state(self) -> Path:
        """Return the folder to which commands write their results."""
        return self.folder / ".harness"

    @property
    def mark(self) -> str:
        """Return a word that no other process on this machine contains."""
        return "mark-" + hashlib.sha256(str(self.folder).encode()).hexdigest()[:16]

    def matrix(self, name: str, text: str) -> Path:
        """Write a matrix file and return its path.

        The words `@WHEELS@`, `@FOLDER@`, `@MARK@` and `@FAKES@` (all runtime fakes) are replaced in the text.
        """
        words = {
            "@WHEELS@": str(self.wheels),
            "@FOLDER@": str(self.folder),
            "@MARK@": self.mark,
            "@FAKES@": json.dumps(runtime_fakes())[1:-1],
        }
        for word, meaning in words.items():
            text = text.replace(word, meaning)
        path = self.folder / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    def run(self, *arguments: str | Path, module: str = "harness", **variables: str) -> CommandResult:
        """Run one command of the harness, or of another module, to its end."""
        with self.started(*arguments, module=module, **variables) as process:
            out, err = process.communicate(timeout=LONGEST)
        return CommandResult(code=process.returncode, out=out, err=err)

    @contextmanager
    def started(
        self, *arguments: str | Path, module: str = "harness", **variables: str
    ) -> Iterator[subprocess.Popen[str]]:
        """Start one command, which is killed when the block ends."""
        process = subprocess.Popen(
            (*(() if self.online else closed_network()), sys.executable, "-m", module, *map(str, arguments)),
            cwd=self.folder,
            env=self.environment(variables),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    def environment(self, variables: Mapping[str, str]) -> dict[str, str]:
        """Return the variables of the tests without those that would point the harness elsewhere."""
        foreign = ("UV_", "PIP_", "HARNESS_", "VIRTUAL_ENV", "CONDA_PREFIX")
        base_variables = {name: value for name, value in os.environ.items() if not name.startswith(foreign)}
        own = {
            "HARNESS_CACHE": str(self.cache),
            "XDG_CONFIG_HOME": str(self.folder / "config"),
            "PIP_CONFIG_FILE": os.devnull,
            "COLUMNS": "200",
            "HARNESS_CONTROLS": "",  # real packages, which no closed network brings
        }
        return base_variables | own | variables


@dataclass(frozen=True, kw_only=True, slots=True)
class DeskRun:
    """A command that has ended, and the desk that holds its results."""

    desk: Desk
    ran: CommandResult


@functools.cache
def runtime_fakes() -> list[str]:
    """Return the fakes that fail at run time: tests that ask for all of them share one installed environment."""
    fakes = [tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted(FAKES.glob("*/fake.toml"))]
    return [
        about["name"]
        for about in fakes
        if about["name"] not in APART
        and (about["name"] in TOGETHER or {"gymnasium", "fake-healthy"} & {*about.get("requires", ())})
    ]


@functools.cache
def closed_network() -> tuple[str, ...]:
    """Return the `unshare` prefix that runs a command without network, or `()` if this machine forbids it."""
    for prefix in (("unshare", "-n"), ("unshare", "-r", "-n")):
        try:
            if subprocess.run((*prefix, "true"), capture_output=True, check=False).returncode == 0:
                return prefix
        except FileNotFoundError:
            return ()
    return ()


def wait_for(happened: Callable[[], bool]) -> None:
    """Wait until `happened` returns true; fail after `PATIENCE` seconds."""
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def find_descendants(pid: int) -> list[int]:
    """Return the ids of all child processes of a process, and of their children."""
    pids = []
    for file in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, file.read_text().split()):
            pids += [child, *find_descendants(child)]
    return pids


def processes_of(mark: str) -> list[int]:
    """Return the ids of processes with this text in their variables or in their command line."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            content = (folder / "environ").read_bytes() + (folder / "cmdline").read_bytes()
        except OSError:  # it has ended, or is somebody else's
            continue
        if mark.encode() in content:
            pids.append(int(folder.name))
    return pids

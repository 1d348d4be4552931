"""The desk on which a fault is done: folders of its own, tiny wheels, no network but the loopback."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import commandline
import wheelhouse
from commandline import CommandResult

from ._declaring import FaultResult, Unavailable

NOBODY = 65534
HOSTILE = """
import glob, json, os, sys, time
import fake_healthy
import gymnasium
{top}

class Hostile(fake_healthy.Healthy):
    def __init__(self, render_mode=None):
        super().__init__(render_mode)
{make}

    def reset(self, *, seed=None, options=None):
{reset}
        return super().reset(seed=seed, options=options)

    def step(self, action):
{step}
        return super().step(action)

    def render(self):
{render}
        return super().render()

    def close(self):
{close}
        return super().close()


gymnasium.register("Hostile-v0", Hostile)
"""
MATRIX = """
requirements = ["fake-healthy"{shared}]
index = {{ no_index = true, find_links = ["{wheels}", "{shelf}"] }}
{more}
[axes]
python = ["host"]

[axes.which.hx]
requirements = ["hx"]
cases = [{{ id = "hx", env = "hx:Hostile-v0", api = "gymnasium"{checks}{case} }}]

[axes.which.neighbour]
cases = [{{ id = "neighbour", env = "fake_healthy:Healthy-v0", api = "gymnasium"{checks} }}]
"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Desk(commandline.Desk):
    """A working folder with a state, a cache and a TMPDIR of its own; `ran` are the commands that ended on it."""

    online: bool = True  # the network is closed around the whole fault
    prefix: tuple[str, ...] = ()
    variables: Mapping[str, str] = field(default_factory=dict)
    ran: list[CommandResult] = field(default_factory=list)

    @property
    def shelf(self) -> Path:
        """Return the folder for the wheels of this fault alone; make it if it does not exist."""
        folder = self.folder / "shelf"
        folder.mkdir(exist_ok=True)
        return folder

    @property
    def scratch(self) -> Path:
        """Return the TMPDIR of its commands."""
        folder = self.folder / "tmp"
        folder.mkdir(exist_ok=True)
        return folder

    def run(self, *arguments: str | Path, module: str = "harness", **variables: str) -> CommandResult:
        """Run one command to its end; its traceback or its exit with 4 breaks the promise of the fault."""
        with self.started(*arguments, module=module, **variables) as process:
            out, err = process.communicate(timeout=commandline.LONGEST)
        self.ran.append(CommandResult(code=process.returncode, out=out, err=err))
        return self.ran[-1]

    @contextmanager
    def started(
        self, *arguments: str | Path, module: str = "harness", **variables: str
    ) -> Iterator[subprocess.Popen[str]]:
        """Start one command; it is ended with the block."""
        process = subprocess.Popen(
            (*self.prefix, sys.executable, "-m", module, *map(str, arguments)),
            cwd=self.folder,
            env=self.environment(variables),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        try:
            yield process
        finally:
            process.kill()
            process.communicate()

    def environment(self, variables: Mapping[str, str]) -> dict[str, str]:
        """Return the variables of its commands."""
        inherited = commandline.Desk.environment(self, {"TMPDIR": str(self.scratch)})
        return {**inherited, "UV_HTTP_RETRIES": "0", **self.variables, **variables}

    def with_variables(self, **variables: str) -> Desk:
        """Return the same desk whose commands have these variables."""
        return replace(self, variables={**self.variables, **variables})

    def under(self, *prefix: str) -> Desk:
        """Return the same desk whose commands have another command before them, such as `prlimit`."""
        return replace(self, prefix=(*self.prefix, *prefix))

    def as_nobody(self) -> Desk:
        """Return the same desk whose commands run without privileges."""
        if os.geteuid() != 0:
            msg = "root, who alone may become nobody"
            raise Unavailable(msg)
        _ = self.shelf, self.scratch
        open_interpreter(self.folder / "python")
        self.cache.mkdir(exist_ok=True)
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        subprocess.run(["chown", "-R", f"{NOBODY}:{NOBODY}", str(self.folder), str(self.cache)], check=True)
        became = self.under("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
        return became.with_variables(HOME=str(home))

    def shelve(self, files: Mapping[str, str], *, version: str = "1.0", **about: Any) -> Path:
        """Put a wheel on the desk's own shelf: texts by path, and the keys of a `fake.toml` (`name`, `requires`)."""
        return wheelhouse.wheel(self.shelf, version, files, about)

    def hostile(
        self,
        name: str = "m",
        *,
        checks: tuple[str, ...] = (),
        case: str = "",
        more: str = "",
        shared: bool = False,
        files: Mapping[str, str] = {},
        **deeds: str,
    ) -> Path:
        """Make the package `hx` and a matrix of two cells: axis `which` is `hx` or `neighbour`, a healthy one.

        Deeds are Python: `top` runs at import, `make`, `reset`, `step`, `render`, `close` in these methods.
        `case` is more of the case in TOML (`memory_mb = 400`), `more` more of the matrix; `shared` puts both cells into
        one environment; `files` are more files of the wheel.
        """
        unknown = deeds.keys() - {"top", "make", "reset", "step", "render", "close"}
        if unknown:
            msg = f"no such deed: {', '.join(sorted(unknown))}"
            raise ValueError(msg)
        bodies = {
            place: textwrap.indent(textwrap.dedent(deeds.get(place, "pass")), "        ")
            for place in ("make", "reset", "step", "render", "close")
        }
        module = HOSTILE.format(top=textwrap.dedent(deeds.get("top", "")), **bodies)
        self.shelve({"hx.py": module, **files}, name="hx", requires=["fake-healthy"])
        text = MATRIX.format(
            shared=', "hx"' if shared else "",
            wheels=self.wheels,
            shelf=self.shelf,
            more=more,
            checks=f", checks = {list(checks)}" if checks else "",
            case=f", {case}" if case else "",
        )
        return self.matrix(name, text)

    def measure(self, matrix: Path | str, *arguments: str, **variables: str) -> CommandResult:
        """Run a matrix and print its document."""
        return self.run("run", matrix, "--json", *arguments, **variables)

    def check_verdicts(
        self, ran: CommandResult, *, code: set[int] | None = None, says: str = "", **promised: set[str]
    ) -> FaultResult:
        """Hold the verdicts of a run of a hostile matrix (by `which`) against those that are promised.

        `says` is a text that the decisive line of a cell that does not work has to contain.
        """
        if not ran.out.startswith("{"):
            return FaultResult(f"exit {ran.code} without a document: {last_line(ran.err)}", False)
        cells = ran.cells("which")
        parts, held = [f"exit {ran.code}"], code is None or ran.code in code
        for which, verdicts in promised.items():
            cell = cells.get(which, {"verdict": "missing", "decisive": None})
            parts.append(f"{which}: {cell['verdict']}" + (f" ({cell['decisive']})" if cell["decisive"] else ""))
            held = held and cell["verdict"] in verdicts
        line = " ".join(str(cell["decisive"] or "") for cell in cells.values())
        return FaultResult("; ".join(parts), held and says in line)


def open_interpreter(scratch: Path) -> None:
    """Let nobody reach this Python though it lies in somebody's closed home: by mounts that only this fault sees."""
    python = Path(sys.executable).resolve()
    closed = next((folder for folder in reversed(python.parents) if not folder.stat().st_mode & 1), None)
    if closed is None:
        return
    if os.getpid() != 1:
        msg = "a Python that nobody may run, or namespaces"
        raise Unavailable(msg)
    inner = closed / python.relative_to(closed).parts[0]
    scratch.mkdir()
    mount = ["mount", "--bind", str(inner), str(scratch)]
    subprocess.run(mount, check=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "mode=755", "none", str(closed)], check=True)
    inner.mkdir()
    subprocess.run(["mount", "--move", str(scratch), str(inner)], check=True)


def last_line(text: str) -> str:
    """Return the last line that is not blank."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else "not a word"

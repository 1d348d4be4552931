"""A cell for somebody's own test functions: they run on the host, what they hand to `run` runs in the cell."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from harness import machine, process
from harness.model import Cell, Expectation
from harness.smoke import judging
from harness.smoke.items import SESSION
from harness.smoke.judging import Kind
from harness.store import cache_folder

TAIL = 4000


class CellFailed(AssertionError):
    """A command in a cell did not end well; the message is how it ended and the end of what it printed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Ran:
    """How a command in a cell ended, and all that it printed."""

    exit_code: int | None
    signal: int | None
    timed_out: bool
    seconds: float
    output: str


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class CellUnderTest:
    """An installed cell. `python` is its interpreter; `variables` are all that a command in it is given,
    `expect` is what the matrix expects of the cell, if not that it works.

    The environment holds what the lock says and nothing else: no pytest, not this package. It is shared and sealed:
    use `run`, which keeps what is written from others.
    """

    id: str
    axes: Mapping[str, str]
    version: str
    python: Path
    environment: Path
    installed: Mapping[str, str]
    variables: Mapping[str, str]
    files: Mapping[str, str]
    expect: Expectation | None

    def __repr__(self) -> str:
        return f"<cell {self.id}>"

    def run(self, code: str, *arguments: str, timeout: float = 120.0, memory_mb: int = 6000, check: bool = True) -> Ran:
        """Run Python source in the cell, in the sandbox that probes run in; with `check` it has to end well."""
        __tracebackhide__ = True
        scratch = Path(tempfile.mkdtemp(prefix="simmatrix-"))
        try:
            ran = self._run(code, arguments, process.Limits(seconds=timeout, memory_mb=memory_mb), scratch)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
        if check and ran.exit_code != 0:
            how = f"no end within {timeout:g} s" if ran.timed_out else f"signal {ran.signal}"
            how = how if ran.exit_code is None else f"exit code {ran.exit_code}"
            message = f"{self.id}: {how}\n{ran.output[-TAIL:]}"
            raise CellFailed(message)
        return ran

    def _run(self, code: str, arguments: tuple[str, ...], limits: process.Limits, scratch: Path) -> Ran:
        home, script = scratch / "home", scratch / "script.py"
        (home / "tmp").mkdir(parents=True)
        for name, content in self.files.items():
            (home / name).parent.mkdir(parents=True, exist_ok=True)
            (home / name).write_text(content, encoding="utf-8")
        script.write_text(code, encoding="utf-8")
        sealed = process.OVERLAY in process.sandbox_mode()
        folder = self.environment if sealed else scratch / "environment"
        if not sealed:
            shutil.copytree(self.environment, folder, symlinks=True)
        command = process.Command(
            argv=(str(folder / self.python.relative_to(self.environment)), "-s", str(script), *arguments),
            cwd=home,
            env={**self.variables, "PYTHONPYCACHEPREFIX": str(cache_folder() / "pycache" / self.environment.name)},
            limits=limits,
            log=scratch / "log.txt",
            profile=process.Profile.CELL,
            home=home,
            sealed=(folder,) if sealed else (),
        )
        done = process.run(command)
        output = done.log.read_text(encoding="utf-8", errors="replace")
        if done.killed or done.out_of_memory:
            why = done.killed or f"it needs more than {limits.memory_mb} MB"
            pytest.fail(f"inconclusive: {self.id}: {why}", pytrace=False)
        return Ran(
            exit_code=done.exit_code,
            signal=done.signal,
            timed_out=done.timed_out,
            seconds=done.seconds,
            output=output,
        )


def tried(config: pytest.Config, cell: Cell) -> CellUnderTest:
    """The cell, installed; one that cannot be ends the test as it would end the item of its install."""
    record = config.stash[SESSION].measuring.environment(cell)
    found = judging.seen(record)
    for phase in found:
        ended = judging.ended(cell, phase, found, frozenset())
        match ended.kind:
            case Kind.PASSED:
                continue
            case Kind.SKIPPED:
                pytest.skip(ended.text)
            case Kind.XFAILED:
                pytest.xfail(ended.text)
            case Kind.FAILED | Kind.INCONCLUSIVE:
                pytest.fail(ended.text, pytrace=False)
    assert record.key
    folder = cache_folder() / "environments" / record.key
    given = {**record.supplied, **cell.environment}
    needs = (*cell.needs, *machine.drawing_needs(given))
    variables = {**machine.base_environment(needs), **given}
    return CellUnderTest(
        id=cell.id,
        axes=cell.axes,
        version=record.python or "",
        python=folder / "bin" / "python",
        environment=folder,
        installed=record.installed or {},
        variables={name: value for name, value in variables.items() if value != ""},
        files=cell.files,
        expect=cell.expect,
    )

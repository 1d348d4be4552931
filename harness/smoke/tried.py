"""Offer a cell to a user's test functions: they run on the host, the code that they pass to `run` runs in the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from harness.machine import process
from harness.machine.files.guarded_files import log_text
from harness.machine.files.scratch_folders import scratch_folder
from harness.machine.store import now
from harness.model import Cell, Expectation
from harness.model.machine_trouble import SHOT
from harness.probes import launch
from harness.smoke import judging
from harness.smoke.items import SESSION
from harness.smoke.judging import Kind

TAIL = 4000


class CellFailed(AssertionError):
    """Error for a command that failed in a cell. The message says how it ended, and shows the end of its output."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CommandResult:
    """The result of a command in a cell: how it ended, and all that it printed."""

    exit_code: int | None
    signal: int | None
    timed_out: bool
    seconds: float
    output: str


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class CellUnderTest:
    """An installed cell. `version` is that of its Python, `expect` the expectation of the matrix, if it has one for it.

    The environment holds what the lock says and nothing else: no pytest, not this package. It is shared and sealed:
    use `run`, which keeps what is written from others.
    """

    id: str
    axes: Mapping[str, str]
    version: str
    installed: Mapping[str, str]
    expect: Expectation | None
    site: launch.Site

    @property
    def python(self) -> Path:
        """Return the path of the cell's interpreter."""
        return self.site.python

    @property
    def environment(self) -> Path:
        """Return the folder of the cell's environment."""
        return self.site.folder

    @property
    def variables(self) -> Mapping[str, str]:
        """Return all variables that a command in the cell is given, except HOME, TMPDIR and XDG_*."""
        return self.site.variables

    def __repr__(self) -> str:
        return f"<cell {self.id}>"

    def run(
        self, code: str, *arguments: str, timeout: float = 120.0, memory_mb: int = 6000, check: bool = True
    ) -> CommandResult:
        """Run Python source in the cell, in the sandbox of probes. With `check`, raise CellFailed unless it exits 0."""
        __tracebackhide__ = True
        with scratch_folder() as scratch:
            ran = self._run(code, arguments, process.Limits(seconds=timeout, memory_mb=memory_mb), scratch)
        if check and ran.exit_code != 0:
            how = f"no end within {timeout:g} s" if ran.timed_out else f"signal {ran.signal}"
            how = how if ran.exit_code is None else f"exit code {ran.exit_code}"
            message = f"{self.id}: {how}\n{ran.output[-TAIL:]}"
            raise CellFailed(message)
        return ran

    def _run(self, code: str, arguments: tuple[str, ...], limits: process.Limits, scratch: Path) -> CommandResult:
        script = scratch / "script.py"
        script.write_text(code, encoding="utf-8")
        with launch.set_up(self.site, scratch, "tried") as place:
            done = launch.run_watched(place, process.run(place.command(("-s", str(script), *arguments), limits)))
        # None of these ends says anything about the user's code, so there is no result to be returned.
        if done.killed or done.out_of_memory or done.shot:
            why = done.killed or (SHOT if done.shot else None) or f"it needs more than {limits.memory_mb} MB"
            pytest.fail(f"inconclusive: {self.id}: {why}", pytrace=False)
        return CommandResult(
            exit_code=done.exit_code,
            signal=done.signal,
            timed_out=done.timed_out,
            seconds=done.seconds,
            output=log_text(done.log),
        )


def prepare_cell(config: pytest.Config, cell: Cell) -> CellUnderTest:
    """Return the installed cell. If it cannot be installed, end the test as the item of its install would end."""
    record, site = config.stash[SESSION].measuring.environment(cell)
    phases = judging.collect_phases(record)
    for phase in phases:
        ended = judging.judge_phase(cell, phase, phases, frozenset(), now())
        match ended.kind:
            case Kind.PASSED:
                continue
            case Kind.SKIPPED:
                pytest.skip(ended.text)
            case Kind.XFAILED:
                pytest.xfail(ended.text)
            case Kind.FAILED | Kind.INCONCLUSIVE:
                pytest.fail(ended.text, pytrace=False)
    assert site
    return CellUnderTest(
        id=cell.id,
        axes=cell.axes,
        version=record.python or "",
        installed=record.installed or {},
        expect=cell.expect,
        site=site,
    )

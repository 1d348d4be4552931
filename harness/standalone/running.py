"""Start processes for the single file. The harness has its own spawner, with its supervisor."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from contextlib import suppress
from typing import Callable, Mapping, NamedTuple, Optional, Sequence

from .failures.lines import signal_name

OUTPUT_LIMIT = 400000
"""Bytes of the output that are read."""


class ProcessResult(NamedTuple):
    """The end of a process; `output` is what it wrote, both streams in order."""

    code: Optional[int]
    signal: Optional[str]
    timed_out: bool
    output: str


Run = Callable[[Sequence[str], Mapping[str, str], str, float], ProcessResult]
"""Runs a command with these variables, in this folder, for so many seconds at most."""


def run(argv: Sequence[str], variables: Mapping[str, str], folder: str, seconds: float) -> ProcessResult:
    """Run a command to its end, or to that of its time; then its whole group is ended."""
    # A file takes any amount of output while nobody reads; a full pipe would block the process.
    with tempfile.TemporaryFile() as log:
        try:
            process = subprocess.Popen(
                list(argv),
                cwd=folder,
                env=dict(variables),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except OSError as error:
            return ProcessResult(None, None, timed_out=False, output="{}: {}".format(argv[0], error.strerror))
        timed_out = False
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            timed_out = True
        finally:
            _end(process)
        log.seek(max(0, log.seek(0, os.SEEK_END) - OUTPUT_LIMIT))
        output = log.read().decode("utf-8", "replace")
    code = process.returncode
    return ProcessResult(None if code < 0 else code, signal_name(-code) if code < 0 else None, timed_out, output)


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End all that is left of the group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()

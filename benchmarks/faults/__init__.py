r"""Declared faults: each is done for real in a scratch desk, and what came is held against a promise.

    python -m benchmarks.faults                    run all (what was run with this code before is not run again)
    python -m benchmarks.faults -k '3*' -k '*fifo*' run those whose row, name or module fits
    python -m benchmarks.faults --list             list them
    python -m benchmarks.faults --write            run what is missing, then write `reports/faults/`

Every module of this folder whose name begins with a letter is one of faults and is found by itself. A fault is a
function under the decorator `fault`:

    from benchmarks.faults import FaultResult, Desk, fault

    @fault(
        "36",                                       # the row: unique, any word
        section="hostile probes",
        done="a probe writes one line of 100,000 `[` into its reply",
        promise="its cell is broken or inconclusive, its neighbour works",
        limit=120,                                  # seconds; past them the promise is broken
    )
    def deep_reply(desk: Desk) -> FaultResult:
        matrix = desk.hostile(
            top="reply = [fd for fd in os.listdir('/proc/self/fd') if 'reply' in os.readlink('/proc/self/fd/' + fd)]",
            step="os.write(int(reply[0]), b'[' * 100_000 + b'\\n')",
        )
        return desk.judged(desk.measure(matrix), hx={"broken", "inconclusive"}, neighbour={"works"})

A desk has a folder, a state, a cache and a TMPDIR of its own, a shelf of tiny wheels and no network but the loopback
(`desk.hostile` makes a wheel that does a deed, and a matrix with it and a healthy neighbour; `desk.shelve` makes any
wheel; `desk.run` is the command line, `desk.as_nobody()` the same without privileges). The function returns what came
in one sentence and whether the promise held, or raises `Unavailable("what is missing here")`. As root each fault runs
in PID, mount, IPC and network namespaces of its own: mounts vanish and processes end with it. Two more promises are
held for every fault: no command of the harness shows a traceback or ends with 4, and none leaves a process behind.

What no mechanism can hold says `documented="HEADING"`: a heading of `docs/threat-model.md`. It is run all the same.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [path for path in (str(ROOT / "tests"), str(ROOT / "tests" / "e2e" / "spine")) if path not in sys.path]

from ._declaring import Fault, FaultResult, Unavailable, fault, load_faults  # noqa: E402 - the desk lies among the tests
from ._desk import CommandResult, Desk  # noqa: E402

__all__ = ["ROOT", "CommandResult", "Desk", "Fault", "FaultResult", "Unavailable", "fault", "load_faults"]

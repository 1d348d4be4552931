"""Tell where the seconds of a run go: `python -m benchmarks.run_profile` measures and writes `benchmarks/profile.md`.

It is the six-cell job of `peers.py`, ours alone, in the same three states. Every command that runs under the supervisor
says how long it ran and how long it had a core; what is left is our own.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import shutil
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks import peers

PAGE = Path(__file__).parent / "profile.md"
STATES = {peers.COLD: (), peers.WARM: ("--fresh",), peers.AGAIN: ()}
TRACED = "--traced"
OWN, SUPERVISION = "the harness itself", "supervision: fork server, guards, keepers"
ROWS = ("uv: resolve", "uv: environments", "byte code", "looks at this machine", "probes")
HEAD = """# Where the seconds of a run go

Made by `python -m benchmarks.run_profile --runs {runs}` on {day}: Python {python}, {system}, {cores} cores; medians of
{runs} rounds of the six-cell job of [peers.md](peers.md). Commands run beside each other, so their seconds add up to
more than the run. Core-seconds are those that all processes of a command had a core.
"""


# --- in the process that is measured ---------------------------------------------------------------------------


def trace(into: Path, arguments: Sequence[str]) -> int:
    """Run a verb with every command noted in a file; return its exit code."""
    begun = time.monotonic()
    from harness import __main__ as command_line  # noqa: PLC0415 - its import is part of what is measured
    from harness.machine import process  # noqa: PLC0415

    notes: list[dict[str, Any]] = []
    gate = threading.Lock()
    start, wait = process.start, process.Running.wait
    starts: dict[int, float] = {}

    def noted_start(command: process.Command) -> process.Running:
        now = time.monotonic() - begun
        running = start(command)
        starts[id(running)] = now
        return running

    def noted_wait(self: process.Running, timeout: float | None = None) -> process.Completed | None:
        completed: process.Completed | None = wait(self, timeout)  # type: ignore[call-overload]
        with gate:
            if completed and id(self) in starts:
                row, at = kind(completed.argv), starts.pop(id(self))
                notes.append(
                    {"row": row, "at": at, "seconds": completed.seconds, "core_seconds": completed.core_seconds}
                )
        return completed

    process.start, process.Running.wait = noted_start, noted_wait  # type: ignore[method-assign, assignment]
    imported = time.monotonic() - begun
    code = command_line.main(list(arguments))
    own = resource.getrusage(resource.RUSAGE_SELF)
    into.write_text(
        json.dumps(
            {
                "imported": imported,
                "seconds": time.monotonic() - begun,
                "own": own.ru_utime + own.ru_stime,
                "commands": notes,
            }
        )
    )
    return code


def kind(argv: Sequence[str]) -> str:
    """Return the row of a command."""
    text = " ".join(argv)
    if Path(argv[0]).name == "uv":
        return ROWS[0] if " compile " in text else ROWS[1]
    if "bootstrap" in text:
        return ROWS[4]
    return ROWS[2] if "marshal.dumps" in text else ROWS[3]


# --- outside ---------------------------------------------------------------------------------------------------


def measure(bench: peers.Bench, work: Path, state: str) -> dict[str, Any]:
    """Run the job once, and return the trace, with the core-seconds of the whole and the seconds from outside."""
    traced = work / "trace.json"
    module = (sys.executable, "-m", "benchmarks.run_profile", TRACED, traced, "run", "probes.toml", *STATES[state])
    before, begun = peers.of_children(), time.monotonic()
    bench.call(work, module, PYTHONPATH=str(PAGE.parents[1]))
    outside = {"outside": time.monotonic() - begun, "all": peers.of_children() - before}
    return {**json.loads(traced.read_text()), **outside}


def rows(trace_of_run: Mapping[str, Any]) -> dict[str, tuple[int, float, float]]:
    """Return what each kind of command was: how often, its seconds, its core-seconds."""
    by_row: dict[str, tuple[int, float, float]] = {}
    for row in ROWS:
        ones = [one for one in trace_of_run["commands"] if one["row"] == row]
        by_row[row] = (len(ones), sum(one["seconds"] for one in ones), sum(one["core_seconds"] for one in ones))
    commands = sum(core for _, _, core in by_row.values())
    by_row[OWN] = (1, trace_of_run["seconds"], trace_of_run["own"])
    by_row[SUPERVISION] = (len(trace_of_run["commands"]), 0.0, trace_of_run["all"] - commands - trace_of_run["own"])
    return by_row


def render(traces: Mapping[str, Sequence[Mapping[str, Any]]], runs: int) -> str:
    """Return the page."""
    lines = [
        HEAD.format(
            runs=runs,
            day=f"{datetime.now(UTC):%Y-%m-%d}",
            python=platform.python_version(),
            system=f"{platform.system()} {platform.machine()}",
            cores=peers.CORES,
        )
    ]
    for state, ones in traces.items():

        def middle(read: Callable[[Mapping[str, Any]], float], among: Sequence[Mapping[str, Any]] = ones) -> float:
            return statistics.median(map(read, among))

        probes = [
            [one["at"] for one in each["commands"] if one["row"] == ROWS[4]]
            for each in ones
            if any(one["row"] == ROWS[4] for one in each["commands"])
        ]
        lines += [
            f"## {state}",
            "",
            f"{middle(lambda one: one['outside']):.2f} s, {middle(lambda one: one['all']):.2f} core-seconds. "
            f"Imports before the command line is read: {middle(lambda one: one['imported']):.2f} s."
            + (f" First probe after {statistics.median(map(min, probes)):.2f} s." if probes else ""),
            "",
            "| what | times | seconds | core-seconds |",
            "| --- | --: | --: | --: |",
        ]
        for row in (OWN, SUPERVISION, *ROWS):
            count, seconds, core = (statistics.median(rows(one)[row][place] for one in ones) for place in range(3))
            if count:
                lines.append(f"| {row} | {count:.0f} | {f'{seconds:.2f}' if seconds else ''} | {core:.2f} |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--print", action="store_true", help="print the page and do not write it")
    chosen = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: peers.CORES])
    traces: dict[str, list[dict[str, Any]]] = {state: [] for state in STATES}
    with tempfile.TemporaryDirectory() as folder:
        bench = peers.prepared(Path(folder))
        for number in range(chosen.runs):
            work = bench.folder / "work" / str(number)  # none is deleted before the end, see `peers.rounds`
            shutil.copytree(peers.HERE / "peers", work)
            (work / "wheels").symlink_to(bench.wheels)
            for state, ones in traces.items():
                ones.append(measure(bench, work, state))
                print(f"{state}: {ones[-1]['outside']:.2f} s", file=sys.stderr)
    text = render(traces, chosen.runs)
    if not chosen.print:
        PAGE.write_text(text)
    print(text)


if __name__ == "__main__":
    if sys.argv[1:2] == [TRACED]:
        sys.exit(trace(Path(sys.argv[2]), sys.argv[3:]))
    main()

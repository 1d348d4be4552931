"""Measure what a user waits for: `python -m benchmarks.waiting` writes `waiting.md`, each line with its floor.

A floor is the least that the same answer costs without the harness: the same check files by hand, the same text read by
a bare interpreter, the same documents decoded. Medians; both sides in turn. It needs the network once.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from uv import find_uv_bin

from harness.model import Case
from harness.model.vocabulary import CHECKS, STANDARD
from harness.probes import launch, wire

PAGE = Path(__file__).parent / "waiting.md"
ROOT = PAGE.parents[1]
MATRIX = """
snapshot = 2026-11-20
requirements = ["gymnasium[classic-control]"]
[axes]
python = ["3.11"]
gymnasium = ["0.29.1", "1.2.3"]
[[cases]]
env = "CartPole-v1"
api = "gymnasium"
"""
INSTANT = "2026-11-20T23:59:59Z"
WANTED = "gymnasium[classic-control]==1.2.3"
TEXT = "Traceback (most recent call last):\nAttributeError: module 'numpy' has no attribute 'bool8'\n"
TRIED = ("try", WANTED, "--env", "CartPole-v1", "--python", "3.11", "--as-of", INSTANT)
DECODE = """
import msgspec, pathlib
for one in pathlib.Path('reports').glob('*/report.json'):
    msgspec.json.decode(one.read_bytes())
"""
# The first question to the store ends the process: all before it is the start of a run.
STARTED = """
import os, sys
from harness import __main__
from harness.machine import store
store.open_store = lambda: os._exit(0)
__main__.main(sys.argv[1:])
"""
BARE_START = "import argparse, tomllib, msgspec, packaging.requirements"
HEAD = """# What a user waits for

Made by `python -m benchmarks.waiting --runs {runs}` on {day}: Python {python}, {system}, {cores} cores; medians of
{runs} runs, both sides in turn. Wheels and interpreters are at hand everywhere.

| what | seconds | target | floor | of the floor |
| --- | --: | --- | --- | --: |
"""


@dataclass(frozen=True)
class Wait:
    """One line of the table: a command, how long it may take, and the least that the answer costs."""

    what: str
    limit: float
    ours: Callable[[], float]
    floor: str
    bare: Callable[[], float]


class Bench:
    """The folders and variables that all lines share; each method returns seconds."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.env = {**os.environ, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(folder / "state")}
        self.uv = {**self.env, "UV_CACHE_DIR": str(folder / "cache" / "uv"), "SDL_VIDEODRIVER": "dummy"}
        self.environment = folder / "by-hand"
        self.matrix = folder / "cartpole.toml"
        self.matrix.write_text(MATRIX)
        self.number = 0

    def prepare(self) -> None:
        """Fill the caches, and make the environment that the checks by hand use."""
        self.timed(self.simmatrix("run", str(self.matrix)))
        self.timed(self.simmatrix(*TRIED))
        self.made_by_hand(self.environment)

    def waits(self) -> tuple[Wait, ...]:
        """Return the lines of the table."""
        nothing = (sys.executable, "-I", "-c", "import json, re, sys; sys.stdin.read()")
        decode = (sys.executable, "-c", DECODE)
        start = (sys.executable, "-c", STARTED, "run", str(self.matrix))
        checks = "the two check processes of one cell, environment at hand"
        new_cell = "uv and the interpreter by hand: resolve, make, install, the same checks"
        reports = sorted(map(str, (ROOT / "reports").glob("*/report.json")))
        return (
            Wait(
                "start of `run`, to its first question to the store", 0.1, lambda: self.timed(start),
                "an interpreter that imports argparse, tomllib, msgspec and packaging",
                lambda: self.timed((sys.executable, "-c", BARE_START)),
            ),
            Wait("first result of `run --fresh`, two combinations", 3, self.first_result, checks, self.checks_by_hand),
            Wait("both results of `run --fresh`", 0, self.all_results, checks, self.checks_by_hand),
            Wait("`try` of CartPole, a new environment", 3, self.tried, new_cell, self.tried_by_hand),
            Wait(
                "`explain` of a pasted line", 0.3, lambda: self.timed(self.simmatrix("explain", "-"), TEXT),
                "an interpreter that reads the line", lambda: self.timed(nothing, TEXT),
            ),
            Wait(
                f"`report` of all {len(reports)} committed reports", 1,
                lambda: self.timed(self.simmatrix("report", *reports)),
                "their JSON decoded", lambda: self.timed(decode),
            ),
        )  # fmt: skip

    def first_result(self) -> float:
        """Return the seconds until the terminal shows the result of a first cell."""
        return self.until_a_result(self.simmatrix("run", str(self.matrix), "--fresh"))

    def all_results(self) -> float:
        """Return the seconds of a forced run of everything."""
        return self.timed(self.simmatrix("run", str(self.matrix), "--fresh"))

    def tried(self) -> float:
        """Return the seconds of `try` with no environment and no results; downloads are kept."""
        aside = Path(tempfile.mkdtemp(dir=self.folder))  # nothing is deleted before the end, see `peers.rounds`
        for name in ("state", "cache/environments"):
            (self.folder / name).rename(aside / Path(name).name)
        return self.timed(self.simmatrix(*TRIED))

    def tried_by_hand(self) -> float:
        """Return the seconds of the same by hand."""
        self.number += 1
        start = time.perf_counter()
        place = self.folder / f"hand-{self.number}"
        self.made_by_hand(place)
        self.run_checks(place)
        return time.perf_counter() - start

    def checks_by_hand(self) -> float:
        """Return the seconds of the check processes alone."""
        start = time.perf_counter()
        self.run_checks(self.environment)
        return time.perf_counter() - start

    def made_by_hand(self, place: Path) -> None:
        """Resolve, make an environment and install."""
        uv, lock, wanted = find_uv_bin(), place.with_suffix(".lock"), place.with_suffix(".in")
        wanted.write_text(WANTED + "\n")
        python = ("--python", sys.executable)
        self.timed(
            (uv, "pip", "compile", "-q", "--exclude-newer", INSTANT, "--generate-hashes", *python, wanted, "-o", lock)
        )
        self.timed((uv, "venv", "-q", *python, place))
        into = ("--python", place / "bin" / "python")
        self.timed((uv, "pip", "install", "-q", *into, "--require-hashes", "--no-deps", "-r", lock))

    def run_checks(self, place: Path) -> None:
        """Run the checks of CartPole in two processes, as a cell does."""
        standard = tuple(check for check in CHECKS if check in STANDARD)
        for checks in (standard, ("single.repeat",)):
            folder = Path(tempfile.mkdtemp(dir=self.folder))
            case = Case(id="cartpole", env="CartPole-v1", api="gymnasium", checks=checks)
            request = folder / "request.json"
            request.write_text(wire.request_to_json(wire.request(case, dict.fromkeys(checks, 120.0), folder)))
            self.timed((place / "bin" / "python", "-s", launch.INCELL / "bootstrap.py", request))

    def simmatrix(self, *arguments: str) -> tuple[str, ...]:
        """Return a command line of ours."""
        return (sys.executable, "-m", "harness", *arguments)

    def timed(self, command: Sequence[str | Path], text: str = "") -> float:
        """Run a command that has to do its work; return its seconds. 3 says that some result is inconclusive."""
        start = time.perf_counter()
        ran = subprocess.run(
            tuple(map(str, command)), input=text, text=True, capture_output=True, env=self.uv, cwd=ROOT, check=False
        )
        if ran.returncode not in {0, 3}:
            shown = f"{' '.join(map(str, command))}"[:200]
            sys.exit(f"{shown}: exit code {ran.returncode}\n{ran.stdout[-2000:]}\n{ran.stderr[-2000:]}")
        return time.perf_counter() - start

    def until_a_result(self, command: Sequence[str]) -> float:
        """Start a command; return the seconds until it prints the line of a cell; then let it end."""
        start, seen = time.perf_counter(), 0.0
        with subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=self.uv) as run:
            assert run.stdout
            for line in run.stdout:
                if not seen and "py3." in line and "works" in line:
                    seen = time.perf_counter() - start
        if run.returncode or not seen:
            sys.exit(f"{' '.join(command)}: exit code {run.returncode}, no result seen")
        return seen


def main() -> None:
    """Measure every line and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--print", action="store_true", help="print the page and do not write it")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        bench.prepare()
        lines = []
        for wait in bench.waits():
            pairs = [(wait.ours(), wait.bare()) for _ in range(chosen.runs)]
            ours, bare = (statistics.median(pair[side] for pair in pairs) for side in (0, 1))
            met = f"≤ {wait.limit:g} s: {'met' if ours <= wait.limit else 'missed'}" if wait.limit else ""
            lines.append(f"| {wait.what} | {ours:.2f} | {met} | {wait.floor}: {bare:.2f} s | {ours / bare:.1f} |")
            print(lines[-1], file=sys.stderr)
    head = HEAD.format(
        runs=chosen.runs,
        day=f"{datetime.now(UTC):%Y-%m-%d}",
        python=platform.python_version(),
        system=f"{platform.system()} {platform.machine()}",
        cores=os.cpu_count(),
    )
    text = head + "\n".join(lines) + "\n"
    if not chosen.print:
        PAGE.write_text(text)
    print(text)


if __name__ == "__main__":
    main()

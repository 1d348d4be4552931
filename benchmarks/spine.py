"""Measure what the harness costs: `python benchmarks/spine.py` runs side by side and writes `benchmarks/spine.md`.

Each figure is a median of several runs, the two sides of a ratio in turn. It needs the network once, to fill caches.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import plan_10k
from uv import find_uv_bin

from harness.model import Case
from harness.model.vocabulary import CHECKS, STANDARD
from harness.probes import launch, wire

HERE = Path(__file__).parent
STANDARD_CHECKS = tuple(check for check in CHECKS if check in STANDARD)
"""The checks of a case that asks for none, in their order."""
CELL = """
snapshot = 2026-11-20
requirements = ["gymnasium[classic-control]"]
[axes]
python = ["3.11"]
gymnasium = ["1.2.3"]
[[cases]]
id = "cartpole"
env = "CartPole-v1"
api = "gymnasium"
"""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    ours: str
    other: str
    figure: str
    target: str


def main() -> None:
    """Measure everything and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), runs)
        rows = [bench.help(), bench.plan(), bench.rerun(), bench.overhead()]
    text = render(rows, runs)
    (HERE / "spine.md").write_text(text)
    print(text)


class Bench:
    """Measurements that share one set of warm caches."""

    def __init__(self, folder: Path, runs: int) -> None:
        self.folder, self.runs = folder, runs
        self.env = {**os.environ, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(folder / "state")}

    def help(self) -> Row:
        """Compare our start-up with the import of nox, a tool that everybody waits for anyway."""
        ours, other = self.in_turn(
            lambda: self.timed([sys.executable, "-m", "harness", "--help"]),
            lambda: self.timed([sys.executable, "-c", "import nox"]),
        )
        return Row("`simmatrix --help`", seconds(ours), f"`import nox` {seconds(other)}", f"{ours / other:.2f}", "≤ 2")

    def plan(self) -> Row:
        """Measure `plan` of a matrix of 10,000 combinations, the whole process."""
        file = self.folder / "large.toml"
        file.write_text(plan_10k.matrix_text())
        command = [sys.executable, "-m", "harness", "plan", str(file), "--json"]
        spent = statistics.median(self.timed(command) for _ in range(self.runs))
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        return Row("`plan` of 10,000 combinations", seconds(spent), "", f"{peak:.0f} MB", "< 2 s, 300 MB")

    def rerun(self) -> Row:
        """Measure `run quickstart` when nothing changed, less the start of the interpreter and its imports."""
        self.simmatrix("run", "quickstart")
        ours, start = self.in_turn(
            lambda: self.timed([sys.executable, "-m", "harness", "run", "quickstart"]),
            lambda: self.timed([sys.executable, "-m", "harness", "run", "--help"]),
        )
        more = f"{ours - start:.2f} s more"
        return Row(
            "`run quickstart`, nothing changed", seconds(ours), f"its start-up {seconds(start)}", more, "< 0.5 s"
        )

    def overhead(self) -> Row:
        """Compare one new cell, downloads cached, with uv and the interpreter doing the same work by hand."""
        matrix = self.folder / "one.toml"
        matrix.write_text(CELL)
        self.simmatrix("run", str(matrix))
        ours, bare = self.in_turn(lambda: self.fresh_cell(matrix), self.by_hand)
        difference = f"{ours / bare:.2f}, {ours - bare:.2f} s more"
        return Row("`run` of one new cell", seconds(ours), f"by hand {seconds(bare)}", difference, "measured")

    def fresh_cell(self, matrix: Path) -> float:
        """Return the seconds of a run with an empty store and no environments, downloads cached."""
        for folder in ("state", "cache/environments", "cache/pycache"):
            shutil.rmtree(self.folder / folder, ignore_errors=True)
        return self.simmatrix("run", str(matrix))

    def by_hand(self) -> float:
        """Return the seconds of the same work without the harness.

        Resolve, make the environment, install, and run the same checks in two processes.
        """
        work = Path(tempfile.mkdtemp(dir=self.folder))
        (work / "in.txt").write_text("gymnasium[classic-control]==1.2.3\n")
        python, uv = str(work / "env" / "bin" / "python"), find_uv_bin()
        commands = [
            [uv, "pip", "compile", "-q", "--exclude-newer", "2026-11-20T23:59:59Z", "--generate-hashes",
             "--python", sys.executable, "in.txt", "-o", "out.txt"],
            [uv, "venv", "-q", "--python", sys.executable, "env"],
            [uv, "pip", "install", "-q", "--python", python, "--require-hashes", "--no-deps", "-r", "out.txt"],
            [python, "-s", str(launch.INCELL / "bootstrap.py"), self.request(work, STANDARD_CHECKS)],
            [python, "-s", str(launch.INCELL / "bootstrap.py"), self.request(work, ("single.repeat",))],
        ]  # fmt: skip
        env = {**self.env, "UV_CACHE_DIR": str(self.folder / "cache" / "uv"), "SDL_VIDEODRIVER": "dummy"}
        start = time.perf_counter()
        for command in commands:
            subprocess.run(command, check=True, cwd=work, env=env, stdout=subprocess.DEVNULL)
        spent = time.perf_counter() - start
        shutil.rmtree(work)
        return spent

    def request(self, work: Path, checks: tuple[str, ...]) -> str:
        """Write a request to the in-cell side for these checks of CartPole, and return its path."""
        folder = Path(tempfile.mkdtemp(dir=work))
        case = Case(id="cartpole", env="CartPole-v1", api="gymnasium", checks=checks)
        limits = dict.fromkeys(checks, 120.0)
        request = wire.request(case, limits, folder)
        (folder / "request.json").write_text(wire.request_to_json(request))
        return str(folder / "request.json")

    def simmatrix(self, *arguments: str) -> float:
        """Run the command once and return the seconds."""
        return self.timed([sys.executable, "-m", "harness", *arguments])

    def timed(self, command: Sequence[str]) -> float:
        """Return the wall-clock seconds of a command that has to succeed."""
        start = time.perf_counter()
        subprocess.run(command, check=True, env=self.env, cwd=self.folder, capture_output=True)
        return time.perf_counter() - start

    def in_turn(self, first: Callable[[], float], other: Callable[[], float]) -> tuple[float, float]:
        """Return the medians of both, measured in turn so that a noisy machine is noisy for both; one warm-up each."""
        first(), other()
        pairs = [(first(), other()) for _ in range(self.runs)]
        return statistics.median(p[0] for p in pairs), statistics.median(p[1] for p in pairs)


def seconds(value: float) -> str:
    """Return seconds as the table shows them."""
    return f"{value:.2f} s"


def render(rows: Sequence[Row], runs: int) -> str:
    """Return the table, with what is needed to repeat it."""
    lines = [f"| {row.what} | {row.ours} | {row.other} | {row.figure} | {row.target} |" for row in rows]
    return "\n".join(
        [
            "# What the harness costs",
            "",
            f"Made by `python benchmarks/spine.py --runs {runs}` on {datetime.now(UTC):%Y-%m-%d}: Python "
            f"{platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores; "
            f"medians of {runs} runs in turn.",
            "",
            "| what | harness | beside it | ratio or difference | target |",
            "| --- | --- | --- | --- | --- |",
            *lines,
            "",
        ]
    )


if __name__ == "__main__":
    main()

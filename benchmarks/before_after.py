"""Compare the CPU seconds of two commits: `python benchmarks/before_after.py COMMIT` writes `before_after.md`.

The jobs are those of `spine.py` and `peers.py`. Both sides take turns, so that a noisy machine is noisy for both; the
ratio of a job is the geometric mean over its rounds, with the 95 % interval of Student's t. It needs the network once.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import plan_10k
import spine
from uv import find_uv_bin

HERE = Path(__file__).parent
ROUNDS = 9
STUDENT = {5: 2.776, 7: 2.447, 9: 2.306}
"""Student's t at 97.5 %, by the number of rounds."""

MOST = 1.05
"""Where the lower end of the interval of the ratio may lie."""

SIX = """
snapshot = 2026-11-20
requirements = ["gymnasium[classic-control]"]
[axes]
python = ["3.10", "3.11", "3.12"]
gymnasium = ["0.29.1", "1.2.3"]
[[cases]]
env = "CartPole-v1"
api = "gymnasium"
"""
FRESH = ("state", "cache/environments", "cache/pycache")
"""Folders without which a run finds nothing but downloads."""


@dataclass(frozen=True, kw_only=True)
class Side:
    """One commit: its interpreter, and the folder of its caches."""

    python: Path
    folder: Path

    def cpu(self, *arguments: str) -> float:
        """Return the CPU seconds of a command, and of all processes that it waited for. Exits where it fails."""
        env = {
            **os.environ,
            "HARNESS_CACHE": str(self.folder / "cache"),
            "HARNESS_STATE": str(self.folder / "state"),
        }
        command = [str(self.python), "-m", "harness", *arguments]
        with tempfile.TemporaryFile() as output:
            process = subprocess.Popen(command, env=env, cwd=self.folder, stdout=output, stderr=output)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                output.seek(0)
                sys.exit(
                    f"{' '.join(command)}: exit code {process.returncode}\n{output.read().decode(errors='replace')}"
                )
        return used.ru_utime + used.ru_stime

    def forget(self) -> None:
        """Remove results and environments, and keep downloads."""
        for name in FRESH:
            shutil.rmtree(self.folder / name, ignore_errors=True)


def run_fresh(matrix: str) -> Callable[[Side], float]:
    """Return a job that measures a matrix of which nothing is known, its downloads cached."""

    def job(side: Side) -> float:
        side.forget()
        return side.cpu("run", matrix)

    return job


JOBS: dict[str, Callable[[Side], float]] = {
    "`--help`": lambda side: side.cpu("--help"),
    "`plan` of 10,000 combinations": lambda side: side.cpu("plan", "large.toml", "--json", "--offline"),
    "`run` of one new cell": run_fresh("one.toml"),
    "`run` of six new cells": run_fresh("six.toml"),
    "`run --fresh` of six cells": lambda side: side.cpu("run", "six.toml", "--fresh"),
    "`run` of six cells, nothing changed": lambda side: side.cpu("run", "six.toml"),
}
"""Jobs in their order: one may use what the job before it left."""


def main() -> None:
    """Measure both commits in turn and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit")
    parser.add_argument("--rounds", type=int, choices=STUDENT, default=ROUNDS)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder, "tree")
        called("git", "worktree", "add", "--detach", "--force", str(tree), args.commit)
        try:
            before = prepared(Path(folder, "before"), installed(tree))
            after = prepared(Path(folder, "after"), Path(sys.executable))
            timings = measured(before, after, args.rounds)
        finally:
            called("git", "worktree", "remove", "--force", str(tree))
    text = page(args.commit, args.rounds, timings)
    (HERE / "before_after.md").write_text(text)
    print(text)


def called(*command: str) -> None:
    """Run a command that has to succeed."""
    subprocess.run(command, check=True, cwd=HERE.parent, capture_output=True)


def installed(tree: Path) -> Path:
    """Return an interpreter with the harness of a tree."""
    called(find_uv_bin(), "venv", "-q", "--python", sys.executable, str(tree / ".venv"))
    python = tree / ".venv/bin/python"
    called(find_uv_bin(), "pip", "install", "-q", "--python", str(python), "-e", str(tree))
    return python


def prepared(folder: Path, python: Path) -> Side:
    """Return a side with the files of the jobs in its folder, and all downloads done."""
    folder.mkdir()
    (folder / "large.toml").write_text(plan_10k.matrix_text())
    (folder / "one.toml").write_text(spine.CELL)
    (folder / "six.toml").write_text(SIX)
    side = Side(python=python, folder=folder)
    for job in JOBS.values():
        job(side)
    return side


def measured(before: Side, after: Side, rounds: int) -> dict[str, list[tuple[float, float]]]:
    """Return the CPU seconds of both sides by job, a pair for each round."""
    timings: dict[str, list[tuple[float, float]]] = {name: [] for name in JOBS}
    for number in range(rounds):
        for name, job in JOBS.items():
            if number % 2:
                later = job(after)
                timings[name].append((job(before), later))
            else:
                timings[name].append((job(before), job(after)))
        print(f"round {number + 1} of {rounds}", {name: pairs[-1] for name, pairs in timings.items()}, file=sys.stderr)
    return timings


def interval(pairs: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    """Return the ratio of later to earlier, and both ends of its 95 % interval."""
    logs = [math.log(later / earlier) for earlier, later in pairs]
    middle = statistics.mean(logs)
    half = STUDENT[len(logs)] * statistics.stdev(logs) / math.sqrt(len(logs))
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def page(commit: str, rounds: int, timings: dict[str, list[tuple[float, float]]]) -> str:
    """Return the table, with what is needed to repeat it."""
    lines = [
        "# CPU seconds before and after",
        "",
        f"Made by `python benchmarks/before_after.py {commit}` on {datetime.now(UTC):%Y-%m-%d}: Python "
        f"{platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores; {rounds} "
        f"rounds, the sides in turn, medians. The lower end of each interval is to be at most {MOST}.",
        "",
        f"| what | {commit} | now | ratio | 95 % interval | held |",
        "| --- | ---: | ---: | ---: | --- | --- |",
    ]
    for name, pairs in timings.items():
        ratio, low, high = interval(pairs)
        earlier, later = (statistics.median(pair[side] for pair in pairs) for side in (0, 1))
        held = "yes" if low <= MOST else "no"
        row = [name, f"{earlier:.2f} s", f"{later:.2f} s", f"{ratio:.2f}", f"{low:.2f} to {high:.2f}", held]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()

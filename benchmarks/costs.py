"""Append what the harness itself costs today to `costs.jsonl`: `python -m benchmarks.costs`; `nox -s costs` calls it.

Each figure is in seconds that all processes of a command had a core, a median of several runs. A fixed loop of Python,
timed between them, tells how fast the machine was; figures are compared after division by it. What costs more than a
quarter more than the median of the five entries before is marked.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks import peers, run_profile

HISTORY = Path(__file__).parent / "costs.jsonl"
ROOT = HISTORY.parents[1]
GROWTH, PLAN = HISTORY.with_name("growth.py"), HISTORY.with_name("plan_10k.py")
CELLS = 1_000
BEFORE, SLOWER = 5, 1.25
LINE = "AttributeError: module 'numpy' has no attribute 'bool8'\n"


def yardstick() -> float:
    """Return the core-seconds of a fixed loop: how slow this machine is at the moment."""
    start = time.process_time()
    total = 0
    for number in range(3_000_000):
        total += number % 7
    return time.process_time() - start


def computed(command: Sequence[str | Path], text: str = "") -> float:
    """Run a command that has to succeed, with no results of this user's; return its core-seconds and its children's."""
    with tempfile.TemporaryDirectory() as state:
        env = {**os.environ, "HARNESS_STATE": state}
        before = peers.of_children()
        words = tuple(map(str, command))
        subprocess.run(words, input=text, text=True, check=True, capture_output=True, cwd=ROOT, env=env)
        return peers.of_children() - before


def commands() -> Iterator[tuple[str, float]]:
    """Yield the core-seconds of commands that measure nothing."""
    simmatrix = (sys.executable, "-m", "harness")
    yield "--help", computed((*simmatrix, "--help"))
    yield "explain of a line", computed((*simmatrix, "explain", "-"), LINE)
    yield "recommend mujoco", computed((*simmatrix, "recommend", "mujoco"))
    yield "imports of run", computed((sys.executable, "-c", "import harness.commands.run"))
    yield "plan of 10,000 combinations", computed((sys.executable, PLAN))


def growth() -> Iterator[tuple[str, float]]:
    """Yield the core-seconds of the stages of a run of many made-up cells."""
    with tempfile.TemporaryDirectory() as folder:
        stages = subprocess.run(
            (sys.executable, GROWTH, "--once", str(CELLS), folder), text=True, check=True, capture_output=True
        )
    yield (
        f"stages of {CELLS:,} cells",
        sum(seconds for stage, seconds in json.loads(stages.stdout).items() if stage not in ("copy", "mb")),
    )


def six_cells(bench: peers.Bench) -> Iterator[tuple[str, float]]:
    """Yield the core-seconds of the six-cell job of `peers.py`, in its three states."""
    work = Path(tempfile.mkdtemp(dir=bench.folder)) / "work"  # none is deleted before the end, see `peers.rounds`
    shutil.copytree(peers.HERE / "peers", work)
    (work / "wheels").symlink_to(bench.wheels)
    for state in run_profile.STATES:
        yield f"six cells, {state}", run_profile.measure(bench, work, state)["all"]


def entries() -> list[dict[str, Any]]:
    """Return the entries of the history, oldest first."""
    return [json.loads(line) for line in HISTORY.read_text().splitlines()] if HISTORY.exists() else []


def compare(entry: Mapping[str, Any], earlier: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line for each figure: what it is, and how many times what it was before."""
    for name, seconds in entry["core_seconds"].items():
        before = [one["core_seconds"][name] / one["yardstick"] for one in earlier if name in one["core_seconds"]]
        ratio = seconds / entry["yardstick"] / statistics.median(before[-BEFORE:]) if before else None
        comparison = "" if ratio is None else f"{ratio:5.2f} times before" + (", SLOWER" if ratio > SLOWER else "")
        yield f"{name:45} {seconds:7.2f} s  {comparison}".rstrip()


def main() -> None:
    """Measure, compare with the history, and append to it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--print", action="store_true", help="print the comparison and append nothing")
    chosen = parser.parse_args()
    figures: dict[str, list[float]] = {}
    speed = []
    with tempfile.TemporaryDirectory() as folder:
        bench = peers.prepared(Path(folder))
        for _ in range(chosen.runs):
            for part in (commands, growth, lambda: six_cells(bench)):
                speed.append(yardstick())
                for name, seconds in part():
                    figures.setdefault(name, []).append(seconds)
    commit = subprocess.run(
        ("git", "rev-parse", "--short", "HEAD"), cwd=ROOT, text=True, capture_output=True, check=True
    )
    entry = {
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "commit": commit.stdout.strip(),
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "runs": chosen.runs,
        "yardstick": round(statistics.median(speed), 3),
        "core_seconds": {name: round(statistics.median(ones), 3) for name, ones in figures.items()},
    }
    print("\n".join(compare(entry, entries())))
    if not chosen.print:
        with HISTORY.open("a") as history:
            history.write(json.dumps(entry) + "\n")


if __name__ == "__main__":
    main()

"""Measure how fast known failures are looked for, and how long `explain` takes: `python benchmarks/matching.py`.

It writes `matching.md`. Every known pattern is searched for in texts of the sizes that are kept of a log, once by the
regular expression alone and once after the literals that it needs; both find the same. Each figure is a median, the
two sides in turn. `explain` is a process of its own, on a line and on logs of 50 MB.
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
from datetime import UTC, datetime
from pathlib import Path

from harness.running.signatures import shipped_signatures
from harness.running.signatures.shipped_signatures import HEAD, TAIL
from harness.standalone.explain.log_excerpt import USUAL
from harness.standalone.failures import matching

HERE = Path(__file__).parent
LINE = (
    "Episode {:07d}: reward {:.3f}, 'numpy' and the environment go on in step() of File \"train.py\", line {}, in run\n"
)


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    patterns = [str(one.pattern) for one in shipped_signatures.load_all() if one.pattern]
    examples = "\n".join(text for one in shipped_signatures.load_all() for text in one.examples)
    rows = [
        _row("what is kept of a cell's log, nothing in it", _log(HEAD + TAIL), patterns, runs),
        _row("what `explain` keeps of a long log, nothing in it", _log(USUAL.head + USUAL.tail), patterns, runs),
        _row("the examples of all of them", examples, patterns, runs),
    ]
    where = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    head = (
        "# Looking for known failures\n\n"
        f"Made by `python benchmarks/matching.py --runs {runs}` on {datetime.now(UTC):%Y-%m-%d}: {where};"
        f" {len(patterns)} patterns, medians of {runs} runs in turn.\n\n"
        "| text | characters | found | patterns alone | literals first | ratio |\n"
        "| --- | --- | --- | --- | --- | --- |\n"
    )
    (HERE / "matching.md").write_text(head + "".join(rows) + _answers(runs))
    print((HERE / "matching.md").read_text())


TRACEBACK = """Traceback (most recent call last):
  File "/home/user/train.py", line {}, in <module>
    env.step(1)
  File "/opt/env/lib/python3.11/site-packages/gym/utils/passive_env_checker.py", line 233, in env_step_passive_checker
    if not isinstance(terminated, (bool, np.bool8)):
AttributeError: module 'numpy' has no attribute 'bool8'
"""
LONG = 50_000_000
LINES = {
    "a line that a signature knows": "AttributeError: module 'numpy' has no attribute 'bool8'\n",
    "a line that a history answers": "ModuleNotFoundError: No module named 'gym.envs.robotics'\n",
    "a line of which nothing is known": "ValueError: no wings\n",
}


def _answers(runs: int) -> str:
    """Return the table of whole answers: seconds from the start of the process, and its memory."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "text.log"
        texts = {**LINES, **{f"50 MB of log, {what}": "" for what in ("one traceback at its end", "one in 50 lines")}}
        for what, line in texts.items():
            file.write_text(line or _long_log(often="50 lines" in what))
            rows.append(_answer_row(what, file, runs))
    load = f"{os.getloadavg()[0]:.0f} on {os.cpu_count()} processors"
    head = f"\n`explain FILE`, medians from the start of the process; the machine's load was {load}:\n\n"
    return head + "| text | seconds | seconds of processor | memory |\n| --- | --- | --- | --- |\n" + "".join(rows)


def _long_log(*, often: bool) -> str:
    lines = _log(LONG).splitlines(keepends=True)
    every = range(0, len(lines), 50) if often else ()
    for place in every:
        lines[place] = TRACEBACK.format(place)
    return "".join([*lines, TRACEBACK.format(7)])


def _answer_row(what: str, file: Path, runs: int) -> str:
    command = (sys.executable, "-m", "harness", "explain", str(file))
    figures = [_run_once(command) for _ in range(runs + 1)][1:]  # the first call makes the file that the others read
    seconds, processor, memory = (statistics.median(column) for column in zip(*figures, strict=True))
    return f"| {what} | {seconds:.2f} s | {processor:.2f} s | {memory:.0f} MB |\n"


SPAWN = """
import os, subprocess, sys, time
start = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
usage = os.wait4(process.pid, 0)[2]
print(time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000)
"""
"""A small process between us and `explain`: Linux counts what a parent held when it forked as the child's memory."""


def _run_once(command: Sequence[str]) -> tuple[float, ...]:
    """Return the seconds, the seconds of processor, and the megabytes that a process took."""
    printed = subprocess.run([sys.executable, "-c", SPAWN, *command], check=True, capture_output=True, text=True)
    return tuple(map(float, printed.stdout.split()))


def _log(size: int) -> str:
    count = size // len(LINE.format(0, 0.5, 0))
    return "".join(LINE.format(number, number / 7, number % 90) for number in range(count))


def _row(what: str, text: str, patterns: Sequence[str], runs: int) -> str:
    def alone(pattern: str) -> bool:
        return matching.compile_once(pattern).search(text) is not None

    def first(pattern: str) -> bool:
        return matching.search(pattern, text) is not None

    hits = [alone(pattern) for pattern in patterns]
    assert hits == [first(pattern) for pattern in patterns], "the two sides differ"
    sides: tuple[list[float], list[float]] = ([], [])
    for _ in range(runs):
        for side, look in zip(sides, (alone, first), strict=True):
            side.append(_seconds(look, patterns))
    slow, fast = (statistics.median(side) for side in sides)
    return f"| {what} | {len(text):,} | {sum(hits)} | {slow:.3f} s | {fast:.3f} s | {slow / fast:.0f} |\n"


def _seconds(look: Callable[[str], bool], patterns: Sequence[str]) -> float:
    start = time.process_time()
    for pattern in patterns:
        look(pattern)
    return time.process_time() - start


if __name__ == "__main__":
    main()

"""Measure how much time it saves to search for literals first: `python benchmarks/matching.py` writes `matching.md`.

Every known pattern is searched for in texts of the sizes that are kept of a log, once by the regular expression alone
and once after the literals that it needs; both find the same. Each figure is a median, the two sides in turn.
"""

from __future__ import annotations

import argparse
import platform
import statistics
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
    (HERE / "matching.md").write_text(head + "".join(rows))
    print((HERE / "matching.md").read_text())


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

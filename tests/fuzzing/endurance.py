"""Two hundred thousand mutated inputs: `python tests/fuzzing/endurance.py`; the table goes to `endurance.md`.

The same seeds give the same inputs. Exit 1 where an input broke a promise; each is kept with its traceback.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent)]

from fuzzing.cell_targets import CELL_TARGETS  # noqa: E402 - the folder of the tests
from fuzzing.driving import LONGEST, FuzzResult, fuzz  # noqa: E402 - the folder of the tests
from fuzzing.targets import TARGETS  # noqa: E402

COUNT = 100_000
SHARES = {
    "matrix files": 0.2, "requirement files": 0.35, "reports": 0.19, "merged reports": 0.05, "sites": 0.01,
    "command lines": 0.2, "replies": 0.6, "frames": 0.35, "metadata": 0.02, "stored records": 0.03,
}  # fmt: skip
"""Of `--count`, for what users write, and once more for what cells leave; those that take longest are fewest."""

EVERY = {**TARGETS, **CELL_TARGETS}

PIECE = 250


def main() -> int:
    """Fuzz every target and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="inputs of users, and as many of cells [100000]")
    parser.add_argument("-j", type=int, default=os.cpu_count() or 1, help="processes [cores]")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="fuzzed-"))
    results = {name: FuzzResult(name=name) for name in EVERY}
    with ProcessPoolExecutor(options.j) as pool:
        for part in pool.map(_piece, *zip(*_pieces(options.count, folder), strict=True)):
            whole = results[part.name]
            whole.count += part.count
            whole.codes += part.codes
            whole.slowest = max(whole.slowest, part.slowest)
            whole.broken += part.broken
            print("\n".join(part.broken), end="\n" * bool(part.broken), file=sys.stderr)
    (HERE / "endurance.md").write_text(table(list(results.values())), encoding="utf-8")
    broken = sum(len(one.broken) for one in results.values())
    print(f"{sum(one.count for one in results.values())} inputs, {broken} broke a promise; inputs in {folder}")
    return 1 if broken else 0


def _pieces(count: int, folder: Path) -> Iterator[tuple[str, int, int, Path]]:
    for name, share in SHARES.items():
        for seed, start in enumerate(range(0, round(count * share), PIECE)):
            yield name, min(PIECE, round(count * share) - start), seed, folder


def _piece(name: str, count: int, seed: int, folder: Path) -> FuzzResult:
    return fuzz(EVERY[name], count, folder / f"work-{os.getpid()}", seed)


def table(results: list[FuzzResult]) -> str:
    """Write what came as Markdown."""
    rows = []
    for result in results:
        codes = Counter(result.codes)
        other = result.count - codes[0] - codes[2] - len(result.broken)
        counts = (result.count, codes[0], codes[2], other)
        rows.append(
            f"| {result.name} | {' | '.join(f'{each:,}' for each in counts)} | {result.slowest:.1f} s "
            f"| {len(result.broken)} |"
        )
    total = sum(one.count for one in results)
    lines = [
        "# Mutated inputs",
        "",
        f"{total:,} inputs made from the committed files by seeded mutations (`python tests/fuzzing/endurance.py`).",
        f"An input breaks a promise by a traceback, an exit with 4, no end within {LONGEST:g} s, a write outside its",
        "folder, a process or a connection.",
        "",
        "| what | inputs | accepted (0) | refused (2) | 1 or 3 | slowest | broke a promise |",
        "| --- | --: | --: | --: | --: | --: | --: |",
        *rows,
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())

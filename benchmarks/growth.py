"""Measure how cost grows with size: `python benchmarks/growth.py` runs 10 to 10,000 fake cells, writes `growth.md`.

The cells are planned, looked up, scheduled, stored and reported by the harness itself; only what they would have
measured is made up. Whole commands are timed from outside, by the clock and by what they compute; stages by what they
compute, in a process of their own. Medians of several runs.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
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

import fakecells

from harness.__main__ import GARBAGE
from harness.machine import store, this_machine
from harness.model import Cell, CellRecord, replace
from harness.reports import document, publishing
from harness.reports.text import progress
from harness.running import open_matrix
from harness.running.scheduler import Prepared, Runner, Settings
from harness.running.scheduler.cost_history import Past
from harness.running.scheduler.flow import Flow

HERE = Path(__file__).parent
SIZES = (10, 100, 500, 1_000, 3_000, 10_000)
LARGE, LARGE_MATRICES = 20_000, 5
"""Cells of a matrix, and matrices, which are only planned and looked up in a store that knows none of the cells."""

LIMIT, LIMIT_MB, LARGE_LIMIT = 6, 350, 30
STAGES = {
    "plan": "plan",
    "look up": "locks, installs and records, everything known",
    "schedule": "nothing known: two stages, claims, slots; the probes themselves take no time",
    "store": "records of cells written",
    "report": "report.json, report.md and the table on the terminal",
}
COPY = "copy"
"""Logs, locks and frames put beside the report, while its document is built a first time: a matter of the disk."""


def main() -> None:
    """Measure every size and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--prepare", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--stages", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--look-up", type=Path, nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--once", nargs=2, metavar=("SIZE", "FOLDER"), help="print the stages of one size, as JSON")
    args = parser.parse_args()
    if args.prepare:
        prepare(args.prepare)
        return
    if args.stages:
        print(json.dumps(stages(args.stages)))
        return
    if args.look_up:
        print(json.dumps(look_up(args.look_up)))
        return
    if args.once:
        print(json.dumps(measure_stages(Path(args.once[1]), int(args.once[0]))))
        return
    rows = {}
    for size in args.sizes:
        with tempfile.TemporaryDirectory() as folder:
            rows[size] = measure_size(Path(folder), size, args.runs)
        print(size, rows[size], file=sys.stderr)
    with tempfile.TemporaryDirectory() as folder:
        large = measure_large(Path(folder))
    text = render(rows, args.runs, large)
    (HERE / "growth.md").write_text(text)
    print(text)


# --- one size --------------------------------------------------------------------------------------------------


def measure_stages(folder: Path, size: int) -> dict[str, float]:
    """Return the seconds of each stage and the peak of memory (MB), measured once."""
    matrix = fakecells.write_matrix(folder, size)
    env = {**os.environ, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(folder / "state")}
    called([sys.executable, __file__, "--prepare", str(matrix)], env, folder)
    stages: dict[str, float] = json.loads(called([sys.executable, __file__, "--stages", str(matrix)], env, folder)[3])
    return stages


def measure_size(folder: Path, size: int, runs: int) -> dict[str, float]:
    """Return the seconds of each stage and of whole commands, and peaks of memory (MB)."""
    matrix = fakecells.write_matrix(folder, size)
    state = folder / "state"
    env = {**os.environ, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(state)}
    called([sys.executable, __file__, "--prepare", str(matrix)], env, folder)
    staged = []
    for number in range(runs):
        for name in ("cells", "claims", "reports"):
            if (state / name).exists():  # nothing is deleted before the end, see `peers.rounds`
                (state / name).rename(folder / f"{name}-{number}")
        staged.append(json.loads(called([sys.executable, __file__, "--stages", str(matrix)], env, folder)[3]))
    run = [sys.executable, "-m", "harness", "run", str(matrix)]
    called(run, env, folder)
    again = [called(run, env, folder) for _ in range(runs)]
    return {
        **{stage: statistics.median(one[stage] for one in staged) for stage in (*STAGES, COPY)},
        "stages_mb": max(one["mb"] for one in staged),
        "again": statistics.median(spent for spent, _, _, _ in again),
        "again_computing": statistics.median(computing for _, computing, _, _ in again),
        "again_mb": max(peak for _, _, peak, _ in again),
    }


def measure_large(folder: Path) -> dict[str, float]:
    """Return the seconds in which the large matrices are planned and looked up, and the peak of memory (MB)."""
    matrix = fakecells.write_matrix(folder, LARGE)
    others = [matrix.with_stem(f"{matrix.stem}-{number}") for number in range(1, LARGE_MATRICES)]
    for other in others:
        shutil.copy(matrix, other)
    env = {**os.environ, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(folder / "state")}
    spent, _, peak, text = called([sys.executable, __file__, "--look-up", *map(str, (matrix, *others))], env, folder)
    return {**json.loads(text), "all": spent, "mb": peak}


def look_up(matrices: Sequence[Path]) -> dict[str, float]:
    """Plan matrices and look for their cells in the store; return the seconds of both."""
    gc.set_threshold(GARBAGE)
    start = time.perf_counter()
    opened = store.open_store()
    plans = [open_matrix.set_instant(open_matrix.load(str(matrix), print), opened) for matrix in matrices]
    cells = [cell for plan in plans for cell in plan.cells]
    planned = time.perf_counter()
    runner = Runner(opened, Settings(), progress.Progress(len(cells), 2, progress.headline))
    reported = sum(runner.find_record(cell) is not None for cell in cells)
    assert (len(cells), reported) == (LARGE * LARGE_MATRICES, 0)
    return {"plan": planned - start, "look up": time.perf_counter() - planned}


def called(command: Sequence[str], env: Mapping[str, str], cwd: Path) -> tuple[float, float, float, str]:
    """Run a command that has to succeed; return wall seconds, CPU seconds, peak memory (MB) and its output."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        start = time.perf_counter()
        process = subprocess.Popen(command, env=env, cwd=cwd, stdout=out, stderr=err)
        _, status, usage = os.wait4(process.pid, 0)
        spent = time.perf_counter() - start
        out.seek(0)
        err.seek(0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(f"{' '.join(command)} ended with {process.returncode}:\n{err.read()}")
        return spent, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, out.read()


def prepare(matrix: Path) -> None:
    """Store what a run of the matrix would have measured."""
    opened = store.open_store()
    plan = open_matrix.set_instant(open_matrix.load(str(matrix), print), opened)
    fakecells.fill(plan.cells, opened, progress.Progress(len(plan.cells), 2, progress.headline))


def stages(matrix: Path) -> dict[str, float]:
    """Return the CPU seconds of each stage of a run, done in this process, and its peak memory (MB)."""
    gc.set_threshold(GARBAGE)
    opened = store.open_store()
    here = this_machine.facts()
    timed: dict[str, float] = {}

    @contextlib.contextmanager
    def timing(stage: str) -> Iterator[None]:
        start = time.process_time()
        yield
        timed[stage] = time.process_time() - start

    with timing("plan"):
        plan = open_matrix.set_instant(open_matrix.load(str(matrix), print), opened)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        board = progress.Progress(len(plan.cells), 2, progress.headline)
        first = Runner(opened, Settings(), board)
        records = [record for cell in plan.cells if (record := first.find_record(cell))]
        with timing("store"):
            for record in records:
                first.keep(record)
        del first, records, record
        again = Runner(opened, Settings(), board)
        with timing("look up"):
            records = [record for cell in plan.cells if (record := again.find_record(cell))]
        assert len(records) == len(again.unchanged) == len(plan.cells)
        with timing("schedule"):
            runner = InstantRunner(opened, Settings(jobs=2), board)
            runner.records = {record.cell.id: record for record in records}
            flow = Flow(runner)
            flow.run(plan.cells, Past(opened, lambda: here.id, plan.cells))
        with timing(COPY):
            locate = publishing.place(records, opened, opened.folder / "reports" / plan.matrix)
            document.build(records, [plan], {here.id: here.facts}, store.now(), locate)  # copies what it names
        with timing("report"):
            wanted = publishing.Wanted(out=None, pivot=None, json=False, fail_on=())
            publishing.finish([plan], records, opened, wanted)
    return {**timed, "mb": peak_mb()}


def peak_mb() -> float:
    """Return the peak memory of this process in MB."""
    import resource  # noqa: PLC0415 - of the child only

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class InstantRunner(Runner):
    """A runner that installs and probes cells in no time; everything around that is real."""

    records: Mapping[str, CellRecord]

    def prepare(self, cell: Cell) -> Prepared:
        """Return a cell as ready to be probed."""
        record = self.records[cell.id]
        return Prepared(record=record, cases=cell.cases, claims=(store.digest(cell.id),), environment=record.key)

    def probe(self, ready: Prepared) -> CellRecord:
        """Return the stored record of a cell as probed."""
        return replace(ready.record, reused=False)

    def keep(self, record: CellRecord) -> None:
        """Do nothing: storing is a stage of its own."""


# --- the table -------------------------------------------------------------------------------------------------


def render(rows: Mapping[int, Mapping[str, float]], runs: int, large: Mapping[str, float]) -> str:
    """Return the table, with what is needed to repeat it."""
    heads = ["cells", *STAGES, "together", COPY, "peak", "nothing changed", "computing", "peak"]
    lines = []
    for size, row in rows.items():
        spent = [row[stage] for stage in STAGES]
        figures = [*(f"{one:.2f} s" for one in (*spent, sum(spent), row[COPY])), f"{row['stages_mb']:.0f} MB"]
        again = [f"{row['again']:.2f} s", f"{row['again_computing']:.2f} s", f"{row['again_mb']:.0f} MB"]
        lines.append(" | ".join([f"{size:,}", *figures, *again]))
    return "\n".join(
        [
            "# How cost grows with the number of cells",
            "",
            f"Made by `python benchmarks/growth.py --runs {runs}` on {datetime.now(UTC):%Y-%m-%d}: Python "
            f"{platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores, load "
            f"{os.getloadavg()[2]:.1f} from others; medians of {runs} runs. The stages are in "
            "seconds of computing, which other work on the machine changes little. "
            f"{fakecells.PER_LOCK} cells share a lock; every cell has two cases, four phases each, a log and a frame.",
            "",
            f"| {' | '.join(heads)} |",
            f"|{' ---: |' * len(heads)}",
            *(f"| {line} |" for line in lines),
            "",
            *(f"- *{stage}*: {meaning}" for stage, meaning in STAGES.items() if stage != meaning),
            "- *copy*: logs, locks and frames put beside the report, while its document is built a first time",
            "- *nothing changed*: the whole command `simmatrix run MATRIX`, process start included, the third time",
            "",
            *verdicts(rows),
            f"Target: {LARGE * LARGE_MATRICES:,} cells in {LARGE_MATRICES} matrices planned and looked up under "
            f"{LARGE_LIMIT} s. Reached: {large['plan']:.1f} s for the plans, {large['look up']:.1f} s for looking in a "
            f"store that has none of them, {large['all']:.1f} s with the start of the process, {large['mb']:.0f} MB.",
            "",
        ]
    )


def verdicts(rows: Mapping[int, Mapping[str, float]]) -> Iterator[str]:
    """Yield the targets, and the values that were reached."""
    sizes = sorted(rows)
    if 500 in rows:
        clock, computing = rows[500]["again"], rows[500]["again_computing"]
        yield f"Target: 500 cells, nothing changed, under 1 s. Reached: {clock:.2f} s ({computing:.2f} s compute)."
    if sizes[-1] == 10_000:
        last = rows[10_000]
        together = sum(last[stage] for stage in STAGES)
        reached = f"{together:.1f} s and {last['stages_mb']:.0f} MB"
        yield f"Target: 10,000 cells under {LIMIT} s and {LIMIT_MB} MB. Reached: {reached}."
    if len(sizes) > 1:
        before, after = (sum(rows[size][stage] for stage in STAGES) / size for size in sizes[-2:])
        yield f"Linear: {1000 * before:.2f} ms a cell at {sizes[-2]:,}, {1000 * after:.2f} ms at {sizes[-1]:,}."


if __name__ == "__main__":
    main()

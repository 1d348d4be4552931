"""The six-cell job beside nox, tox and hatch: `python benchmarks/peers.py` measures and writes `benchmarks/peers.md`.

Every tool, and uv with nothing around it (the floor), makes the same environments from one folder of wheels with caches
of its own, and runs the same check files: those of our probes, as plain scripts. It needs the network once, for the
wheels and the tools.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from harness.machine import interpreters
from harness.matrix import matrix_file, plan
from harness.model import Case
from harness.probes import launch, wire

HERE = Path(__file__).parent
MATRIX = HERE / "peers" / "probes.toml"
PYTHONS = ("3.10", "3.11", "3.12")
GYMNASIUM = ("0.29.1", "1.2.3")
PLANNED = plan.make_plan(
    plan.Sources(matrix=matrix_file.read(MATRIX.read_text(), MATRIX.name), host_python=platform.python_version())
)
REQUESTS = {"checks": PLANNED.cells[0].cases[0].checks, "repeat": ("single.repeat",)}
"""What the two processes of a cell are asked: what we ourselves ask, and the same episode again in a second process."""

CORES = 2
SCRIPTS, USUAL = "plain", "tested"
STYLES = {
    SCRIPTS: "the same check files as plain scripts",
    USUAL: "as users use each tool, pytest inside: each check a test; ours: the suite of our plugin",
}
COLD, WARM, AGAIN = "cold", "warm, checks forced to run again", "nothing changed"
OURS, FLOOR = "simmatrix", "bare uv (floor)"
TOOLS = {"nox": ("nox",), "tox": ("tox", "tox-uv"), "hatch": ("hatch",)}
ONLY_PYTEST = {"exceptiongroup", "iniconfig", "packaging", "pluggy", "pygments", "pytest", "tomli"}


class Unequal(Exception):
    """The sides did not do the same work."""


@dataclass(frozen=True)
class Bench:
    """The folders of wheels and tools, and the variables and interpreters that all sides share."""

    folder: Path
    wheels: Path
    tools: Path
    env: Mapping[str, str]
    pythons: Mapping[str, str]

    def call(self, work: Path, command: Sequence[str | Path], **more: str) -> str:
        """Run a command of one side in its folder, with caches of its own; returns what it printed."""
        own = {
            "UV_CACHE_DIR": work / "uv-cache",
            "HARNESS_CACHE": work / "cache",
            "HARNESS_STATE": work / "state",
            "HATCH_DATA_DIR": work / "hatch-data",
            "HATCH_CACHE_DIR": work / "hatch-cache",
            "HATCH_CONFIG": work / "hatch.toml",
        }
        env = {**self.env, **{name: str(path) for name, path in own.items()}, **more}
        done = subprocess.run(
            list(map(str, command)), cwd=work, env=env, text=True, capture_output=True, check=False, errors="replace"
        )
        if done.returncode:
            message = f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
            raise Unequal(message)
        return done.stdout + done.stderr


@dataclass
class Side:
    """One tool: what it runs for a style and a state, and where its environments are."""

    name: str
    run: Callable[[Bench, Path, str, str], int]
    """Does the job in a folder and returns how many tests passed, where they were tests."""
    environments: str
    seconds: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    computed: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    """Seconds that all processes together had a core."""
    checks: dict[str, int] = field(default_factory=dict)
    packages: dict[str, dict[tuple[str, str], frozenset[str]]] = field(default_factory=dict)

    def measure(self, bench: Bench, work: Path, style: str, state: str) -> None:
        """Time one run, count its checks and note what its environments hold."""
        ask(work)
        start, computed = time.perf_counter(), of_children()
        tests = self.run(bench, work, style, state)
        self.seconds.setdefault((style, state), []).append(time.perf_counter() - start)
        self.computed.setdefault((style, state), []).append(of_children() - computed)
        count = count_passed_checks(work)
        if style == USUAL and not tests:
            message = f"{self.name}: no test has passed"
            raise Unequal(message)
        if state != AGAIN and self.checks.setdefault(style, count) != count:
            message = f"{self.name}: {count} checks, and {self.checks[style]} before"
            raise Unequal(message)
        self.packages[style] = dict(packages(work, self.environments))

    def median(self, style: str, state: str) -> float:
        """Return the median seconds of a style in a state."""
        return statistics.median(self.seconds[style, state])

    def describe(self, style: str, state: str) -> str:
        """Return the median seconds, and those of computing, as the table shows them."""
        return f"{self.median(style, state):.2f} s ({statistics.median(self.computed[style, state]):.1f})"


def of_children() -> float:
    """Return the seconds that ended child processes, and their children, have computed."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def packages(work: Path, pattern: str) -> Iterator[tuple[tuple[str, str], frozenset[str]]]:
    """Yield the packages of each environment: (Python, gymnasium), and names with versions."""
    for site in work.glob(f"{pattern}/lib/python3*/site-packages"):
        names = frozenset(path.name.removesuffix(".dist-info") for path in site.glob("*.dist-info"))
        gymnasium = next(name for name in names if name.startswith("gymnasium-"))
        yield (site.parent.name.removeprefix("python"), gymnasium.partition("-")[2]), names


# --- what is asked and answered --------------------------------------------------------------------------------


def ask(work: Path) -> None:
    """Write the request of each cell, by the names that the tools give them; earlier replies are removed."""
    for reply in work.glob("state/evidence/*/reply.jsonl"):
        reply.unlink()
    shutil.rmtree(work / "requests", ignore_errors=True)
    for python in PYTHONS:
        for gymnasium in GYMNASIUM:
            factors = f"{SCRIPTS}-py{python}-gym{gymnasium}".replace(".", "")
            for name in (f"{python}-{gymnasium}", factors):
                for request_name, checks in REQUESTS.items():
                    folder = work / "requests" / name / request_name
                    folder.mkdir(parents=True)
                    case = Case(id="CartPole-v1", env="CartPole-v1", api="gymnasium", checks=checks)
                    limits = dict.fromkeys(checks, 120.0)
                    request = wire.request(case, limits, folder)
                    folder.with_suffix(".json").write_text(wire.request_to_json(request))


def count_passed_checks(work: Path) -> int:
    """Count the checks that passed, by the replies: the peers' beside their requests, ours where evidence is kept."""
    replies = [*work.glob("requests/*/*/reply.jsonl"), *work.glob("state/evidence/*/reply.jsonl")]
    records = [json.loads(line) for reply in replies for line in reply.read_text().splitlines()]
    return sum(record["kind"] == "check" and record["outcome"] == "passed" for record in records)


# --- the sides -------------------------------------------------------------------------------------------------


def count_passed_tests(output: str) -> int:
    """Count the tests that passed, by the output of pytest."""
    return sum(int(number) for number in re.findall(r"^(?:=+ )?(\d+) passed", output, re.MULTILINE))


def nox(bench: Bench, work: Path, style: str, state: str) -> int:
    """Run nox with uv, two sessions at a time; what exists is taken as it is."""
    reuse = () if state == COLD else ("-R",)
    parallel = ("-j", str(CORES), "--allow-parallel")
    return count_passed_tests(bench.call(work, (bench.tools / "nox/bin/nox", "-s", style, *parallel, *reuse)))


def tox(bench: Bench, work: Path, style: str, _state: str) -> int:
    """Run tox with tox-uv, two environments at a time; `-o` shows what they print, so that it can be counted."""
    command = (bench.tools / "tox/bin/tox", "run-parallel", "-p", str(CORES), "-o", "-f", style)
    return count_passed_tests(bench.call(work, command))


def hatch(bench: Bench, work: Path, style: str, _state: str) -> int:
    """Run hatch with uv; it runs its matrix one after the other."""
    uv = str(bench.tools / "hatch/bin/uv")
    command = (bench.tools / "hatch/bin/hatch", "run", f"{style}:checks")
    return count_passed_tests(bench.call(work, command, HATCH_ENV_TYPE_VIRTUAL_UV_PATH=uv))


def ours(bench: Bench, work: Path, style: str, state: str) -> int:
    """Run simmatrix, two cells at a time as it does by itself."""
    if style == USUAL:
        more = ("--matrix-fresh",) if state == WARM else ()
        suite = ("--pyargs", "harness.smoke", "--matrix", "probes.toml", "-q", "--matrix-jobs", str(CORES))
        return count_passed_tests(bench.call(work, (sys.executable, "-m", "pytest", *suite, *more)))
    more = ("--fresh",) if state == WARM else ()
    return count_passed_tests(bench.call(work, (sys.executable, "-m", "harness", "run", "probes.toml", *more)))


def bare(bench: Bench, work: Path, style: str, state: str) -> int:
    """Run uv and the interpreter alone, cells spread over the cores."""
    uv = bench.tools / "hatch/bin/uv"

    def cell(versions: tuple[str, str]) -> int:
        python, gymnasium = versions
        place = work / "bare" / f"{python}-{gymnasium}"
        if state == COLD:
            wanted = (f"gymnasium[classic-control]=={gymnasium}", *(["pytest"] if style == USUAL else []))
            bench.call(work, (uv, "venv", "-q", "--python", bench.pythons[python], place))
            bench.call(work, (uv, "pip", "install", "-q", "--python", place / "bin/python", *wanted))
        if style == USUAL:
            return count_passed_tests(bench.call(work, (place / "bin/pytest", "-q", "checks")))
        for request_name in REQUESTS:
            request = work / "requests" / place.name / f"{request_name}.json"
            bench.call(work, (place / "bin/python", "-s", "incell/bootstrap.py", request))
        return 0

    with ThreadPoolExecutor(CORES) as pool:
        return sum(pool.map(cell, [(python, gymnasium) for python in PYTHONS for gymnasium in GYMNASIUM]))


def sides() -> tuple[Side, ...]:
    """Return all sides, in the order of the table."""
    return (
        Side(OURS, ours, "cache/environments/*"),
        Side("nox", nox, ".nox/*"),
        Side("tox", tox, ".tox/*"),
        Side("hatch", hatch, "hatch-data/env/virtual/*"),
        Side(FLOOR, bare, "bare/*"),
    )


# --- the job ---------------------------------------------------------------------------------------------------


def main() -> None:
    """Measure everything and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--style", choices=STYLES, action="append", help="only this way of checking, and no file")
    args = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    measured = sides()
    with tempfile.TemporaryDirectory() as folder:
        bench = prepared(Path(folder))
        tools = {tool: installed(bench.tools / tool, tool) for tool in TOOLS}
        for style in args.style or STYLES:
            for number in range(args.runs):
                rounds(bench, measured, style, number)
            compare(measured, style)
    styles = args.style or list(STYLES)
    text = render(measured, styles, args.runs, tools)
    if not args.style:
        (HERE / "peers.md").write_text(text)
    print(text)


def prepared(folder: Path) -> Bench:
    """Prepare wheels and tools, once; every side sees the same interpreters, the same uv and no index."""
    foreign = ("UV_", "PIP_", "HARNESS_", "NOX", "TOX", "HATCH", "VIRTUAL_ENV", "PYTHON")
    user = dict(os.environ)
    clean = {name: value for name, value in user.items() if not name.startswith(foreign)}
    by_version = {python: interpreters.find(python) for python in PYTHONS}
    pythons = {python: one.path for python, one in by_version.items() if one}
    if len(pythons) < len(PYTHONS):
        message = f"Pythons {', '.join(PYTHONS)} are needed; here are {', '.join(pythons) or 'none of them'}"
        raise SystemExit(message)
    fetched = {**user, "HARNESS_CACHE": str(folder / "cache"), "HARNESS_STATE": str(folder / "state")}
    fetch = (sys.executable, "-m", "harness", "fetch", HERE / "peers/wheels.toml", "--to", folder / "fetched")
    subprocess.run(fetch, env=fetched, check=True, capture_output=True)
    (folder / "wheels").mkdir()
    for wheel in folder.glob("fetched/wheels/*/*.whl"):
        shutil.copy(wheel, folder / "wheels")
    uv = Path(sys.executable).with_name("uv")
    for tool, wanted in TOOLS.items():
        place = folder / "tools" / tool
        subprocess.run((uv, "venv", "-q", "--python", sys.executable, place), check=True)
        pins = (*wanted, f"uv=={version('uv')}")
        subprocess.run((uv, "pip", "install", "-q", "--python", place / "bin/python", *pins), check=True)
    env = {
        **clean,
        "PATH": os.pathsep.join([*(str(Path(path).parent) for path in pythons.values()), clean["PATH"]]),
        "UV_FIND_LINKS": str(folder / "wheels"),
        "UV_NO_INDEX": "1",
        "UV_PYTHON_DOWNLOADS": "never",
        "SDL_VIDEODRIVER": "dummy",
    }
    return Bench(folder=folder, wheels=folder / "wheels", tools=folder / "tools", env=env, pythons=pythons)


def rounds(bench: Bench, measured: Sequence[Side], style: str, number: int) -> None:
    """Run one round: every side once in each state, another one first each time."""
    turn = [*measured[number % len(measured) :], *measured[: number % len(measured)]]
    # Each round has folders of its own, and none is deleted before the end: in the minutes after many files were
    # deleted, ext4 looks at each freed inode before it takes one for a new file, which takes seconds of a cold run.
    place = bench.folder / "work" / f"{list(STYLES).index(style)}-{number}"
    works = {side.name: place / re.sub(r"\W", "", side.name) for side in turn}
    for work in works.values():
        shutil.copytree(HERE / "peers", work)
        shutil.copytree(launch.INCELL, work / "incell", ignore=shutil.ignore_patterns("__pycache__"))
        (work / "wheels").symlink_to(bench.wheels)
        (work / "hatch.toml").touch()
    for state in (COLD, WARM, AGAIN):
        for side in turn:
            side.measure(bench, works[side.name], style, state)
            print(f"{number + 1} {style} {state}: {side.name} {side.describe(style, state)}", file=sys.stderr)


def compare(measured: Sequence[Side], style: str) -> None:
    """Raise Unequal if the sides have different packages or ran different numbers of checks."""
    cells = len(PYTHONS) * len(GYMNASIUM)
    reference = measured[0].packages[style]
    for side in measured:
        extra = ONLY_PYTEST if style == USUAL and side.name != OURS else set()
        cell_packages = {
            cell: frozenset(name for name in names if name.partition("-")[0] not in extra)
            for cell, names in side.packages[style].items()
        }
        if cell_packages != reference or len(cell_packages) != cells:
            message = f"{side.name} has other packages in its environments than {OURS}: {cell_packages} and {reference}"
            raise Unequal(message)
        wanted = measured[0].checks[style]
        if side.checks[style] != wanted:
            message = f"{side.name} ran {side.checks[style]} checks, not {wanted}"
            raise Unequal(message)


def installed(tool: Path, name: str) -> str:
    """Return the version of a tool."""
    process = subprocess.run((tool / "bin" / name, "--version"), capture_output=True, text=True, check=True)
    match = re.search(r"\d+(?:\.\d+)+", process.stdout + process.stderr)
    return match[0] if match else "?"


# --- the table -------------------------------------------------------------------------------------------------


def render(measured: Sequence[Side], styles: Sequence[str], runs: int, tools: Mapping[str, str]) -> str:
    """Return both tables, with what is needed to repeat them."""
    named = ", ".join(f"{tool} {number}" for tool, number in tools.items())
    lines = [
        "# The six-cell job beside other tools",
        "",
        f"Made by `python benchmarks/peers.py --runs {runs}` on {datetime.now(UTC):%Y-%m-%d}: Python "
        f"{platform.python_version()}, {platform.system()} {platform.machine()}, {CORES} cores, uv {version('uv')}, "
        f"{named}; medians of {runs} rounds, the sides in turn.",
        "",
        f"Python {', '.join(PYTHONS)} with gymnasium {' and '.join(GYMNASIUM)}: CartPole in a loop, in a sync and an "
        "async vector, rendered. Packages come from one folder of wheels, so that no side waits for a network; cold is "
        "with all caches empty, uv's too, and in a new folder: nothing is deleted between the rounds. The tools "
        "themselves are installed before. Every side has the same packages and no others in its environments: compared "
        "by name and version. nox and tox run two cells at a time, hatch "
        "has no such mode. Where nothing changed the other tools run their checks again, which is all they can do. In "
        "brackets: seconds that all processes together had a core. As plain scripts, every side runs the in-cell files "
        "of our probes in two processes for each cell, the checks and one episode again; ours under its supervisor. "
        "With pytest inside, the others have a test for each check, which reads the reply of the same two processes; "
        f"ours is the suite of our plugin, with `--matrix-jobs {CORES}`. "
        "Checks are counted in the replies that those files write, in both styles. Where the seconds of ours go is in "
        "[profile.md](profile.md).",
    ]
    for style in styles:
        lines += ["", f"## {STYLES[style]}", "", *table(measured, style)]
    return "\n".join([*lines, ""])


def table(measured: Sequence[Side], style: str) -> list[str]:
    """Return the lines of the table: one row for each state, with the target where there is one."""
    peers = [side for side in measured if side.name in TOOLS]
    by_name = {side.name: side for side in measured}
    heads = " | ".join(f"{side.name}, {side.checks[style]} checks" for side in measured)
    lines = [f"| state | {heads} | of the best | target |", "| --- " * (len(measured) + 3) + "|"]
    for state in (COLD, WARM, AGAIN):
        best = min(side.median(style, state) for side in peers)
        mine, floor = by_name[OURS].median(style, state), by_name[FLOOR].median(style, state)
        limit = {COLD: max(best, 1.15 * floor), WARM: max(best, 1.15 * floor), AGAIN: 0.1 * best}[state]
        limit = limit if style == SCRIPTS else best
        times = " | ".join(side.describe(style, state) for side in measured)
        met = "met" if mine <= limit else "missed"
        target = f"≤ {limit:.2f} s: {met}"
        lines.append(f"| {state} | {times} | {mine / best:.2f} | {target} |")
    return lines


if __name__ == "__main__":
    main()

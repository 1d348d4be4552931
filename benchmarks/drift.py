"""Measure what behaviour costs: `python -m benchmarks.drift [--releases N]` writes `benchmarks/drift.md`.

It steps Gymnasium's eleven MuJoCo tasks (v5) from their banks with some MuJoCo releases, whose wheels are brought
before the clock starts. Then it judges all pairs of the committed report, compares two measured cells, and checks a
frozen file.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from harness.machine import this_machine

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "benchmarks" / "drift.md"
MATRIX = ROOT / "matrices" / "drift-mujoco.toml"
RELEASES = ("3.1.6", "3.2.7", "3.3.7", "3.5.0", "3.9.0", "3.12.0")
ALL = 45
"""Releases of the aim."""

TASK = "Hopper-v5"


def main() -> None:
    """Measure all of it and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--releases", type=int, default=len(RELEASES), help="how many releases are stepped")
    args = parser.parse_args()
    releases = RELEASES[: args.releases]
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as folder:
        rows = list(_measure(Path(folder), releases))
    PAGE.write_text(_page(rows, releases), encoding="utf-8")
    print(PAGE.read_text(encoding="utf-8"))


def _measure(folder: Path, releases: tuple[str, ...]) -> list[tuple[str, str, str]]:
    matrix = folder / "drift.toml"
    matrix.write_text(_small_matrix(releases), encoding="utf-8")
    shutil.copytree(MATRIX.parent / "banks", folder / "banks")
    state = {"HARNESS_STATE": str(folder / "state")}
    bare = folder / "bare.toml"
    bare.write_text(re.sub(r'"single.loop", "behave"', "", matrix.read_text(encoding="utf-8")), encoding="utf-8")
    _time("run", bare, "-j", "2", HARNESS_STATE=str(folder / "other"))  # installs all that is needed
    stepping = _time("run", matrix, "-j", "2", **state)
    seconds = stepping / len(releases) * ALL
    cells = [f"{matrix}/py3.11_gymnasium-1.2.3_mujoco-{version}" for version in releases[-2:]]
    pair = ("compare", *cells, "--env", TASK)
    _time(*pair, **state)
    frozen = folder / "frozen.npz"
    _time("freeze", cells[0], "--env", TASK, "--out", frozen, **state)
    judging = _time("report", "--judge-again", ROOT / "reports" / "drift-mujoco")
    compared = min(_time(*pair, **state) for _ in range(3))
    checked = _time("freeze", cells[1], "--env", TASK, "--check", frozen, HARNESS_STATE=str(folder / "third"))
    only = folder / "only.toml"
    only.write_text(_small_matrix(releases[-1:], TASK).replace('"single.loop", "behave"', ""), encoding="utf-8")
    bare_check = _time("run", only, "--fresh", HARNESS_STATE=str(folder / "third"))
    return [
        (f"eleven tasks, {len(releases)} releases, two cells at a time", f"{stepping:.0f} s", ""),
        (f"the same for {ALL} releases, as a multiple", f"{seconds / 60:.1f} min", "10 min"),
        (
            "judging all pairs of reports/drift-mujoco (47 releases, 22 tasks), with its evidence read",
            f"{judging:.1f} s",
            "20 s",
        ),
        ("`compare` of two measured cells, one task", f"{compared:.2f} s", "1 s"),
        (f"`freeze --check` of {TASK}, not measured before", f"{checked:.1f} s", ""),
        (f"a cell that only imports the packages of {TASK}", f"{bare_check:.1f} s", "1 s less than the line above"),
    ]


def _small_matrix(releases: tuple[str, ...], tasks: str = '-v5"') -> str:
    """Return the matrix of the report with some tasks and releases."""
    text = MATRIX.read_text(encoding="utf-8")
    text = re.sub(r"mujoco = \{ range.*", f"mujoco = {list(releases)}".replace("'", '"'), text)
    head, *cases = text.split("[[cases]]")
    return "[[cases]]".join([head, *(case for case in cases if tasks in case)])


def _time(*arguments: str | Path, **variables: str) -> float:
    """Run `simmatrix` and return the seconds it took. Exit status 1 is a difference, and no failure."""
    began = time.monotonic()
    command = (sys.executable, "-m", "harness", *map(str, arguments))
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **variables}, capture_output=True, text=True, check=False
    )
    if done.returncode not in {0, 1}:
        raise SystemExit(done.stderr)
    return time.monotonic() - began


def _page(rows: list[tuple[str, str, str]], releases: tuple[str, ...]) -> str:
    facts: Mapping[str, object] = this_machine.facts().facts
    lines = [
        "# What behaviour costs",
        "",
        f"Measured on {datetime.now(UTC):%Y-%m-%d} by `python -m benchmarks.drift`, on {facts.get('os')}, "
        f"{os.cpu_count()} cores, {facts.get('memory_mb')} MB, Python {platform.python_version()}; "
        f"MuJoCo {', '.join(releases)}. "
        "Wheels were at hand.",
        "",
        "| what | measured | aim |",
        "| --- | --: | --- |",
        *(f"| {what} | {value} | {aim} |" for what, value, aim in rows),
        "",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()

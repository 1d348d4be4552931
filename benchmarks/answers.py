"""Time the verbs that only look things up: `python benchmarks/answers.py --write` writes `answers.md`.

Each command runs `RUNS` times in a process of its own; the fastest run counts, since a busy machine adds to all others.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

HERE = Path(__file__).parent
RUNS = 7
LIMIT = 0.5
CELL = "gymnasium-mujoco/py3.13_gymnasium-1.4.0_mujoco-3.12.0"
TRIED = ("try", "gymnasium==1.2.3", "--python", "3.11", "--env", "CartPole-v1")
COMMANDS = (
    ("recommend", "gymnasium", "mujoco"),
    ("recommend", "robosuite", "torch"),
    ("known",),
    ("known", "mujoco"),
    ("known", "mujoco-before-numpy2-vectors"),
    ("show", CELL),
    ("check", "-r", "requirements.txt"),
    ("check", "--python", "environment"),
    ("upgrade", "mujoco", "-r", "requirements.txt"),
    ("upgrade", "mujoco==3.5.0", "--python", "environment"),
    ("explain", "line.txt"),
    TRIED,
)
LINES = 500
"""Lines of the requirement file; as many packages lie in the environment."""

PINS = {"gymnasium": "1.2.3", "mujoco": "3.4.0", "numpy": "2.4.6", "imageio": "2.38.1", "packaging": "26.3"}
ERROR = "AttributeError: module 'numpy' has no attribute 'bool8'"


def main() -> int:
    """Time every command; 1 where one is too slow."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write answers.md")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        write_inputs(Path(folder))
        seconds = {command: fastest(command, Path(folder)) for command in COMMANDS}
    lines = [
        "# Verbs that look things up",
        "",
        f"Made by `python benchmarks/answers.py --write`: the fastest of {RUNS} runs, in seconds, a process each;"
        f" {datetime.now(UTC):%Y-%m-%d}, Python {platform.python_version()}, {os.cpu_count()} cores. `try` is of what"
        f" was measured before. The requirement file has {LINES} lines, the environment as many packages.",
        "",
        "| command | seconds |",
        "| --- | --- |",
        *(f"| `simmatrix {' '.join(command)}` | {taken:.2f} |" for command, taken in seconds.items()),
    ]
    print("\n".join(lines))
    if args.write:
        (HERE / "answers.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(max(seconds.values()) > LIMIT)


def write_inputs(folder: Path) -> None:
    """Write a requirement file and an environment of `LINES` packages, and a line to explain."""
    pins = {**PINS, **{f"some-package-{number}": f"1.{number}" for number in range(LINES - len(PINS))}}
    (folder / "requirements.txt").write_text("".join(f"{name}=={version}\n" for name, version in pins.items()))
    (folder / "line.txt").write_text(f"{ERROR}\n")
    root = folder / "environment"
    (root / "bin").mkdir(parents=True)
    (root / "bin" / "python").symlink_to(sys.executable)
    (root / "pyvenv.cfg").write_text("version = 3.11.7\n")
    for name, version in pins.items():
        info = root / "lib" / "python3.11" / "site-packages" / f"{name.replace('-', '_')}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Name: {name}\nVersion: {version}\nRequires-Dist: numpy>=1.20\n\n")


def fastest(command: tuple[str, ...], folder: Path) -> float:
    """Return the seconds of the fastest run; the first one, which fills the caches, does not count."""
    taken = []
    for _ in range(RUNS + 1):
        began = perf_counter()
        environment = {**os.environ, "HARNESS_STATE": str(folder / "state")}
        done = subprocess.run(
            [sys.executable, "-m", "harness", *command],
            capture_output=True,
            env=environment,
            check=False,
            text=True,
            cwd=folder,
        )
        taken.append(perf_counter() - began)
        if done.returncode not in {0, 1, 3}:
            sys.exit(f"{' '.join(command)}: {done.stderr}")
    return min(taken[1:])


if __name__ == "__main__":
    sys.exit(main())

"""Type forty packages into `simmatrix try`: `python benchmarks/typed.py run|score [NAME...]` on the list `typed.toml`.

`run` types each line that has no answer yet (`--fresh`: again), `score` holds the answers against `typed-truth.toml`,
written by hand with plain Python where an answer is red, and writes `typed.md`. `--folder` is where answers lie.
"""

from __future__ import annotations

import argparse
import json
import platform
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Any

HERE = Path(__file__).parent
LIST = HERE / "typed.toml"
TRUTH = HERE / "typed-truth.toml"
PAGE = HERE / "typed.md"
FOLDER = Path(".harness/typed")
SECONDS = 1800


@dataclass(frozen=True)
class Line:
    """One line of the list, its answer, and what is true of it."""

    name: str
    table: Mapping[str, Any]
    answer: Mapping[str, Any] | None
    truth: Mapping[str, Any]

    @property
    def command(self) -> str:
        """Return the command line to type."""
        return shlex.join(["simmatrix", "try", *self.table["typed"], "--python", self.table["python"]])

    @property
    def grade(self) -> str:
        """`right` or `honest` where exit code and text are those of the truth, else `wrong`."""
        if self.answer is None:
            return "not run"
        if not self.truth:
            return "not judged"
        text = " ".join(self.answer["text"].split())
        fits = self.answer["exit"] == self.truth["exit"] and all(part in text for part in self.truth["says"])
        return str(self.truth["grade"]) if fits else "wrong"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run or score the list; 1 where an answer is wrong or lacks a judgement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verb", choices=["run", "score"])
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these lines of the list")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where answers lie [%(default)s]")
    parser.add_argument("--fresh", action="store_true", help="type again what has an answer")
    args = parser.parse_intermixed_args(arguments)
    lists = tomllib.loads(LIST.read_text())
    if args.verb == "run":
        args.folder.mkdir(parents=True, exist_ok=True)
        for line in _lines(lists, args.folder, args.names):
            if line.answer is None or args.fresh:
                _type(line, lists["snapshot"], args.folder)
        return 0
    lines = list(_lines(lists, args.folder, ()))
    PAGE.write_text(page(lines, lists))
    grades = Counter(line.grade for line in lines)
    print(", ".join(f"{number} {grade}" for grade, number in sorted(grades.items())))
    return 0 if set(grades) <= {"right", "honest"} else 1


def _lines(lists: Mapping[str, Any], folder: Path, names: Sequence[str]) -> Iterator[Line]:
    truths = tomllib.loads(TRUTH.read_text()) if TRUTH.exists() else {}
    for name, table in {**lists["package"], **lists["also"]}.items():
        if names and name not in names:
            continue
        path = folder / f"{name}.json"
        answer = json.loads(path.read_text()) if path.exists() else None
        yield Line(name, table, answer, truths.get(name, {}))


def _type(line: Line, snapshot: str, folder: Path) -> None:
    """Type a line as a user would, as the index stood at the list's instant, and keep the answer."""
    command = [sys.executable, "-m", "harness", *shlex.split(line.command)[1:], "--as-of", snapshot]
    began = monotonic()
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    refused = [line for line in done.stderr.splitlines() if line.startswith("simmatrix: ")]
    answer = {
        "exit": done.returncode,
        "text": done.stdout.strip() or "\n".join(refused),
        "stderr": done.stderr[-4000:],
        "seconds": round(monotonic() - began, 1),
        "on": datetime.now(UTC).date().isoformat(),
    }
    (folder / f"{line.name}.json").write_text(json.dumps(answer, indent=1))
    print(f"{line.name}: exit {answer['exit']}, {answer['seconds']} s: {answer['text'].splitlines()[:1]}", flush=True)


def page(lines: Sequence[Line], lists: Mapping[str, Any]) -> str:
    """Return the page: how many of the answers are right, and each with what was typed and what is true."""
    forty = [line for line in lines if line.name in lists["package"]]
    counts = Counter(line.grade for line in forty)
    days = sorted({line.answer["on"] for line in lines if line.answer})
    figures = ", ".join(f"{counts[grade]} {grade}" for grade in ("right", "honest", "wrong", "not judged", "not run"))
    parts = [
        "# Forty packages typed into `simmatrix try`\n",
        f"Made by `python benchmarks/typed.py run` and `score` on {' and '.join(days)}: {platform.system()} "
        f"{platform.machine()}, the index as it stood on {lists['snapshot']}. The list, [typed.toml](typed.toml), with "
        "what is right of each, was written before the first run. [typed-truth.toml](typed-truth.toml) says what plain "
        "Python said, by hand, where an answer is not `works`.\n",
        f"**Of {len(forty)} packages: {figures}.** *Honest* is an answer that says what it could not find out.\n",
    ]
    for line in lines:
        parts.append(f"## {line.name}: {line.grade}\n")
        text = line.answer["text"] if line.answer else "(not run)"
        code = f"\nexit code {line.answer['exit']}" if line.answer else ""
        parts.append(f"```\n$ {line.command}\n{text}{code}\n```\n")
        parts.append(f"Listed before: *{line.table['right']}*. {line.table['because']}\n")
        if line.truth.get("hand"):
            parts.append(f"By hand: {line.truth['hand']}\n")
    return "\n".join(parts)


if __name__ == "__main__":
    sys.exit(main())

"""Answer forty lines in the terminal of a fresh machine: `python -m benchmarks.forty` writes `forty.md`.

They are lines of the half of `lines.toml` that was set aside: those whose ids have the smallest SHA-256. Each is piped
into `simmatrix explain` in a process with an empty home folder, an empty cache and 80 columns.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from benchmarks import lines

COUNT = 40
PAGE = Path(__file__).parent / "forty.md"
HEAD = """# Forty lines in the terminal of a fresh machine

Made by `python -m benchmarks.forty`: lines of [lines.toml](lines.toml) that people pasted in threads, drawn by the hash
of their ids from the half that was set aside, and opened once the rules were finished. Each was piped into
`simmatrix explain -` with an empty home folder, an empty cache and 80 columns; the first one waits for the cache.
"""


def main() -> None:
    """Answer the lines and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    counts: Counter[str] = Counter()
    pages = []
    with tempfile.TemporaryDirectory() as home:
        for answer in draw():
            code, text = ask(answer.line["text"], Path(home))
            counts[answer.verdict] += 1
            pages.append(describe(answer, code, text))
    figures = ", ".join(f"{counts[verdict]} {verdict}" for verdict in lines.VERDICTS)
    print(figures)
    PAGE.write_text("\n".join([HEAD, f"Of {COUNT}: {figures}.\n", *pages]), encoding="utf-8")


def draw() -> Iterator[lines.Answer]:
    """Yield the answers for the drawn lines, as the benchmark judges them."""
    aside = sorted(lines.answers(is_aside=True), key=lambda answer: hashlib.sha256(answer.line["id"].encode()).digest())
    yield from aside[:COUNT]


def ask(text: str, home: Path) -> tuple[int, str]:
    """Return the exit code and what the terminal shows."""
    environment = {
        "HOME": str(home),
        "HARNESS_CACHE": str(home / "cache"),
        "HARNESS_STATE": str(home / "state"),
        "PATH": os.defpath,
        "COLUMNS": "80",
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }
    command = [sys.executable, "-m", "harness", "explain", "-"]
    done = subprocess.run(command, input=text, capture_output=True, text=True, env=environment, cwd=home, check=False)
    return done.returncode, done.stdout + done.stderr


def describe(answer: lines.Answer, code: int, text: str) -> str:
    """Return the part of the page about one line."""
    line = answer.line
    side = line["side"].replace("other", "at fault otherwise")
    truth = f"True: {line['package']} is {side}. {line['cause']} Fix: {line['fix']}."
    pasted, shown = (part.rstrip().replace("```", "'''") for part in (line["text"], text))
    return (
        f"## [{line['id']}]({line['source']}): {answer.verdict}\n\n```\n{pasted}\n```\n\n{truth}\n\n"
        f"```\n$ simmatrix explain -\n{shown}\n(exit status {code})\n```\n"
    )


if __name__ == "__main__":
    main()

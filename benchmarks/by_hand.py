"""Repeat twenty combinations with plain uv and Python: `by_hand.py [--write]`.

`by_hand.toml` has the scripts. Each runs in an empty environment that uv alone installs from the lock of the committed
report; a combination that cannot be resolved is resolved once more. `--write` writes `by_hand.md`. The exit code is 1
where a script ends otherwise than the report says.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from harness.machine import interpreters

HERE = Path(__file__).parent
REPORTS = HERE.parent / "reports"
DRAWN, PAGE = HERE / "by_hand.toml", HERE / "by_hand.md"
SECONDS = 900
LINES = 3
"""Lines of the output, from its end, in one of which the line has to stand: interpreters warn as they end."""


def entry(cell: str) -> dict[str, Any]:
    """Return a cell of the committed reports."""
    document = json.loads((REPORTS / cell.partition("/")[0] / "report.json").read_bytes())
    return next(one for one in document["cells"] if one["id"] == cell)


def repeat(drawn: dict[str, Any], folder: Path) -> str:
    """Return the last lines of uv or of the script."""
    cell = entry(drawn["id"])
    environment = {**os.environ, **cell["supplied"], **cell["environment"]}
    environment.pop("PYTHONPATH", None)
    venv = folder / "venv"
    python = interpreters.find(cell["python"] or cell["requested_python"])
    if python is None:
        return f"no Python {cell['requested_python']} here"
    subprocess.run(["uv", "venv", "-q", "-p", str(python.path), str(venv)], check=True)
    command = ["uv", "pip", "install", "-q", "-p", str(venv)]
    if "requirements" in drawn:
        command += [*drawn["requirements"]]
    else:
        command += ["--require-hashes", "-r", str(REPORTS / drawn["id"].partition("/")[0] / cell["lock"])]
    installed = subprocess.run(command, capture_output=True, text=True, check=False)
    if installed.returncode or "script" not in drawn:
        return " ".join(line.strip(" │╰─▶") for line in installed.stderr.splitlines())
    script = folder / "by_hand.py"
    script.write_text(drawn["script"])
    done = subprocess.run(
        [str(venv / "bin" / "python"), str(script)],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False,
    )  # fmt: skip
    output = done.stdout if done.returncode == 0 else done.stderr
    return "\n".join(output.strip().splitlines()[-LINES:])


def main() -> int:
    """Repeat all, and write the page if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="*", metavar="GLOB", help="repeat these alone")
    parser.add_argument("--write", action="store_true")
    args = parser.parse_args()
    rows = []
    for drawn in (one for one in tomllib.loads(DRAWN.read_text())["cell"] if fnmatchcase(one["id"], args.only)):
        folder = Path(tempfile.mkdtemp())
        try:
            output = repeat(drawn, folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        agrees = drawn["ends"] in output
        cell = entry(drawn["id"])
        print(f"{'agrees' if agrees else 'DIFFERS'} {drawn['id']}" + ("" if agrees else f"\n{output}"), flush=True)
        rows.append((drawn["id"], cell["verdict"], cell["phase"] or "", drawn["ends"], agrees))
    if args.write:
        PAGE.write_text(page(rows))
    return 0 if all(row[-1] for row in rows) else 1


def page(rows: list[tuple[str, str, str, str, bool]]) -> str:
    """Return the page: each combination, what the report says, and how the script ended."""
    good = sum(row[-1] for row in rows)
    lines = [
        "# Twenty combinations of the families, repeated with plain uv and Python",
        "",
        f"Made by `python benchmarks/by_hand.py --write` on {datetime.now(UTC):%Y-%m-%d}. The scripts"
        f" are in `by_hand.toml`. {good} of {len(rows)} agree with the report.",
        "",
        "| combination | verdict | fails in | the script ends with | agrees |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [f"| `{a}` | {b} | {c} | {d} | {'yes' if e else '**no**'} |" for a, b, c, d, e in rows]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())

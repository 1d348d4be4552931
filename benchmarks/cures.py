"""Run the command of an answer in a real environment: `python -m benchmarks.cures` writes `cures.md`.

`cures.toml` has, for ten lines of `forty.md`, an environment in which the line appears, and the program that raises it.
The environment is made by `venv`, by `uv`, or laid out as conda does. `explain -- COMMAND` is run in it, the command
that it prints after `next:` is run as it stands, and the program again.
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
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from harness.machine import interpreters

HERE = Path(__file__).parent
FILE, PAGE = HERE / "cures.toml", HERE / "cures.md"
SECONDS = 900
NEXT = re.compile(r"^next:\s+(.*)$", re.MULTILINE)
KINDS = ("venv", "uv", "conda")


@dataclass(frozen=True)
class Cure:
    """The result for one line: the error before, the command that was printed and run, and how the program ended."""

    entry: Mapping[str, Any]
    before: str
    command: str
    after: str
    is_cured: bool


def main(arguments: Sequence[str] | None = None) -> int:
    """Cure the environments and write the page. Return 1 if one was not cured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", metavar="ID", help="only these lines, and write no page")
    args = parser.parse_args(arguments)
    entries = tomllib.loads(FILE.read_text(encoding="utf-8"))["cure"]
    cures = []
    for entry in entries:
        if not args.ids or entry["id"] in args.ids:
            cures.append(cure(entry))
            print(f"{entry['id']}: {'cured' if cures[-1].is_cured else 'not cured'}: {cures[-1].command}", flush=True)
            if not cures[-1].is_cured:
                print(cures[-1].before, cures[-1].after, sep="\n---\n", flush=True)
    if not args.ids:
        PAGE.write_text(page(cures), encoding="utf-8")
    return int(not all(each.is_cured for each in cures))


def cure(entry: Mapping[str, Any]) -> Cure:
    """Make the environment, explain the failure of its program, do what is printed, and run the program again."""
    with tempfile.TemporaryDirectory(prefix="cure-") as scratch:
        folder = Path(scratch)
        python = make_environment(folder / "env", entry)
        program = folder / "program.py"
        program.write_text(entry["program"], encoding="utf-8")
        explain = [sys.executable, "-m", "harness", "explain", "--", str(python), str(program)]
        before = run(explain, folder)
        match = NEXT.search(before.stdout + before.stderr)
        command = match.group(1).strip() if match else ""
        # In one shell, so that a variable that the command sets holds for the program.
        # What the installer prints names the index that it asks.
        quiet = f"{{ {command or 'false'}; }} > install.log 2>&1 && {python} {program}"
        after = run(["bash", "-c", quiet], folder)
        is_cured = bool(before.returncode and command and not after.returncode)
        shown = (after.stdout + after.stderr).strip() or "it ends without an error"
        failed, command, shown = (
            text.replace(str(folder), "...") for text in ((before.stdout + before.stderr).strip(), command, shown)
        )
        return Cure(entry, failed, command, shown, is_cured)


def make_environment(folder: Path, entry: Mapping[str, Any]) -> Path:
    """Make an environment with the packages of an entry, and return its Python."""
    interpreter = interpreters.find(entry["python"])
    if interpreter is None:
        message = f"there is no Python {entry['python']} here"
        raise SystemExit(message)
    python = folder / "bin" / "python"
    uv = shutil.which("uv") or "uv"
    if entry["kind"] == "uv":
        check(run([uv, "venv", "-q", "-p", interpreter.path, str(folder)], folder.parent))
        install = [uv, "pip", "install", "-q", "-p", str(python)]
    else:
        check(run([interpreter.path, "-m", "venv", str(folder)], folder.parent))
        install = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    if entry["kind"] == "conda":
        (folder / "conda-meta").mkdir()
        (folder / "conda-meta" / "history").touch()
    for requirements in entry["install"]:
        check(run([*install, *requirements], folder.parent))
    return python


def run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder."""
    environment = {**os.environ, "HARNESS_STATE": str(folder / "state"), "COLUMNS": "100"}
    for name in ("VIRTUAL_ENV", "MUJOCO_GL", "DISPLAY"):
        environment.pop(name, None)
    return subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=folder, timeout=SECONDS, check=False
    )


def check(done: subprocess.CompletedProcess[str]) -> None:
    """Stop where an environment could not be made."""
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)


def page(cures: Sequence[Cure]) -> str:
    """Return the page: one row for each line, then what the terminal showed."""
    day = f"{datetime.now(UTC):%Y-%m-%d}"
    rows = [
        "# Ten lines cured by the command of their answer",
        "",
        f"Made by `python -m benchmarks.cures` on {day}, {platform.system()} {platform.machine()}, from"
        " [cures.toml](cures.toml): in each environment a program fails with the line, `simmatrix explain -- COMMAND`"
        " is asked, the command that it prints is run as it stands, and the program runs again.",
        "An environment of conda's is a virtual environment with conda's folder of records: no conda could be had.",
        "",
        "| line | environment | command that was printed | cured |",
        "| --- | --- | --- | --- |",
    ]
    for each in cures:
        where = f"{each.entry['kind']}, Python {each.entry['python']}"
        rows.append(f"| {each.entry['id']} | {where} | `{each.command}` | {'yes' if each.is_cured else 'no'} |")
    for each in cures:
        rows += ["", f"## {each.entry['id']}", "", "```", each.before, "```", "", "Afterwards:", "", "```"]
        rows += [each.after, "```"]
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    sys.exit(main())

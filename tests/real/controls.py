"""Lock or run the controls of `matrices/controls/`: `--lock ID...` makes locks, else the named or all ones run.

    python tests/real/controls.py [--lock] [ID...]

A lock allows every file of each version that its Python takes on Linux, so that machines of other kinds can use it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote

from packaging.utils import parse_wheel_filename
from uv import find_uv_bin

from harness.judging.assess import assess
from harness.machine import store
from harness.model import Cell, CellRecord, Verdict
from harness.running import controls, scheduler
from harness.running.controls import ControlTable


def lock(table: ControlTable, snapshot: str) -> str:
    """Return the lock of a control's requirements, in the form of its file."""
    with TemporaryDirectory() as folder:
        output, bounds, requirements = (Path(folder) / name for name in ("pylock.toml", "bounds.txt", "asked.txt"))
        bounds.write_text("\n".join(table.build_constraints), encoding="utf-8")
        requirements.write_text("\n".join(table.requirements), encoding="utf-8")
        where = ("--python-version", table.python, "--exclude-newer", snapshot, "--build-constraint", bounds)
        subprocess.run((find_uv_bin(), "pip", "compile", requirements, "-q", "-o", output, *where), check=True)
        packages = tomllib.loads(output.read_text(encoding="utf-8"))["packages"]
    lines = {one["name"]: (f"{one['name']}=={one['version']}", *files(one, table.python)) for one in packages}
    return "".join(" \\\n    --hash=sha256:".join(lines[name]) + "\n" for name in sorted(lines))


def files(package: dict[str, Any], python: str) -> list[str]:
    """Return the hashes of the wheels that this Python accepts on any Linux, or of the sdist if there is none."""
    wheels = [one for one in package.get("wheels", ()) if fits(one["url"].rpartition("/")[2], python)]
    return sorted(one["hashes"]["sha256"] for one in wheels or [package["sdist"]])


def fits(filename: str, python: str) -> bool:
    """Return whether a wheel is for this Python, and for Linux or for anything."""
    minor = int(python.partition(".")[2])
    own = {f"cp3{minor}", f"py3{minor}", "py3", "py2.py3"}
    for tag in parse_wheel_filename(unquote(filename))[3]:
        older = tag.abi == "abi3" and int(tag.interpreter.removeprefix("cp3") or 0) <= minor
        if (tag.interpreter in own or older) and (tag.platform == "any" or "linux" in tag.platform):
            return True
    return False


class StderrObserver:
    """Progress messages on stderr."""

    def started(self, cell: Cell) -> None:
        """Print nothing; the result is printed at the end."""

    def step(self, cell: Cell, text: str) -> None:
        """Print nothing; the result is printed at the end."""

    def done(self, record: CellRecord) -> None:
        """Print the result of a control."""
        self.say(f"{record.cell.label}: {describe(record)}")

    def say(self, text: str) -> None:
        """Print one line."""
        print(text, file=sys.stderr, flush=True)


def describe(record: CellRecord) -> str:
    """Return the verdict and the Python, and what was not verified or why it failed."""
    judged = assess(record)
    more = f"; not verified: {', '.join(judged.unverified)}" if judged.unverified else ""
    why = f" in {judged.phase}: {judged.decisive}" if judged.decisive else ""
    findings = (finding.text for case in record.cases for phase in case.phases for finding in phase.findings)
    summary = f"{judged.verdict}{more}{why} ({record.seconds:.1f} s, python {record.python})"
    return "\n    ".join((summary, *findings))


def main() -> int:
    """Lock or run the controls; return 1 if a control that could run does not work."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", metavar="ID", nargs="*", help="controls [all]")
    parser.add_argument("--lock", action="store_true", help="make the locks anew instead of running")
    parser.add_argument("--fresh", action="store_true", help="run what was run before, too")
    args = parser.parse_args()
    place = controls.folder()
    assert place
    read = controls.read(place)
    if args.lock:
        for table in (one for one in read.control if not args.ids or one.id in args.ids):
            store.write_atomic(place / f"{table.id}.txt", lock(table, read.snapshot).encode())
        return 0
    cells = [cell for cell in controls.cells() if not args.ids or cell.label in args.ids]
    records = scheduler.run(cells, store.open_store(), scheduler.Settings(fresh=args.fresh), StderrObserver())
    verdicts = {assess(record).verdict for record in records}
    return 0 if verdicts <= {Verdict.WORKS, Verdict.UNAVAILABLE} else 1


if __name__ == "__main__":
    sys.exit(main())

"""The controls of `matrices/controls/`: `--lock ID...` makes their locks, else all, or those named, are run.

    python tests/real/controls.py [--lock] [ID...]

A lock allows every file that the index has of each version, so that machines of other kinds can use it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from tempfile import NamedTemporaryFile

from uv import find_uv_bin

from harness import controls, scheduler, store, verdict
from harness.controls import ControlTable
from harness.locks import pinned
from harness.model import Cell, CellRecord, Verdict


def lock(table: ControlTable, snapshot: str) -> str:
    """The lock of a control's requirements, as its file has it."""
    uv = find_uv_bin()
    options = (
        "--generate-hashes",
        "--no-annotate",
        "--no-header",
        "-q",
        "--exclude-newer",
        snapshot,
        "--no-emit-index-url",
    )
    command = (uv, "pip", "compile", "-", "--python-version", table.python, *options)
    asked = "\n".join(table.requirements)
    with NamedTemporaryFile("w", suffix=".txt") as bounds:
        bounds.write("\n".join(table.build_constraints))
        bounds.flush()
        bounded = (*command, "--build-constraint", bounds.name)
        text = subprocess.run(bounded, input=asked, stdout=subprocess.PIPE, text=True, check=True).stdout
    return "".join(
        " \\\n".join((f"{name}=={version}", *(f"    --hash=sha256:{one}" for one in sorted(hashes)))) + "\n"
        for name, (version, hashes) in sorted(pinned(text).items())
    )


class Told:
    """Says on stderr what goes on."""

    def started(self, cell: Cell) -> None:
        """Said at its end."""

    def step(self, cell: Cell, text: str) -> None:
        """Said at its end."""

    def done(self, record: CellRecord) -> None:
        """How a control ended."""
        self.say(f"{record.cell.label}: {describe(record)}")

    def say(self, text: str) -> None:
        """One line."""
        print(text, file=sys.stderr, flush=True)


def describe(record: CellRecord) -> str:
    """Verdict, versions, and what was not verified or why it failed."""
    judged = verdict.judge(record)
    more = f"; not verified: {', '.join(judged.unverified)}" if judged.unverified else ""
    why = f" in {judged.phase}: {judged.decisive}" if judged.decisive else ""
    findings = (finding.text for case in record.cases for phase in case.phases for finding in phase.findings)
    told = f"{judged.verdict}{more}{why} ({record.seconds:.1f} s, python {record.python})"
    return "\n    ".join((told, *findings))


def main() -> int:
    """Lock or run; 1 where a control that could be run does not work."""
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
    records = scheduler.run(cells, store.open_store(), scheduler.Settings(fresh=args.fresh), Told())
    verdicts = {verdict.judge(record).verdict for record in records}
    return 0 if verdicts <= {Verdict.WORKS, Verdict.UNAVAILABLE} else 1


if __name__ == "__main__":
    sys.exit(main())

"""What hides the end of a worker, and what the harness says of it: `python tests/real/masks.py [GLOB]`.

Workers of three generations of gym and four of gymnasium raise, are killed, exit or hang, in their constructor, in
reset() or in step(), while the same environment is well in the process that started them. Through the whole harness:
locks, the repaired gym 0.21, limits. The decisive line has to be the worker's own end every time; the table of the
masks is written to `masks.md`. Exit 1 where one line is another.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from shutil import copytree, ignore_patterns
from tempfile import TemporaryDirectory

from harness import catalog, machine, scheduler, store
from harness.commands.progress import Progress
from harness.commands.reporting import headline
from harness.model import CellRecord, CheckRecord

HERE = Path(__file__).parent
LIBRARIES = {
    "gym 0.17.3": ("3.7", ("gym==0.17.3",)),
    "gym 0.21.0": ("3.9", ("gym==0.21.0", "numpy<2")),
    "gym 0.26.2": ("3.9", ("gym==0.26.2", "numpy<2")),
    "gymnasium 0.26.3": ("3.7", ("gymnasium==0.26.3",)),
    "gymnasium 0.29.1": ("3.10", ("gymnasium==0.29.1", "numpy<2")),
    "gymnasium 1.0.0": ("3.11", ("gymnasium==1.0.0",)),
    "gymnasium 1.4.0": ("3.11", ("gymnasium==1.4.0",)),
}
PLACES = {"make": "constructor", "reset": "reset()", "step": "step()"}
ENDS = {
    "raise": r"ValueError: the true reason",
    "segv": r"worker killed by SIGSEGV \(Fatal Python error: Segmentation fault\) in string_at, ctypes/.* line \d+",
    "kill": r"worker killed by SIGKILL",
    "exit": r"worker exited with code 7 without a word",
    "sysexit": r"SystemExit: 3",
    "hang": r"worker hangs in .*troubled\.py line \d+",
}
"""What the decisive line has to be, by what the worker does."""

CHECK = "vector.async.fork"
MATRIX = """
snapshot = "2026-11-20"
subject = "{subject}"
requirements = {requirements}
overlay = ["gym"]
axes.python = ["{python}"]
cases = [{cases}]
"""
CASE = """{{id = "{place}-{end}", env = "{api}:troubled:Troubled-v0", kwargs.mode = "{place}-child-{end}",\
 checks = ["{check}"], timeouts.vector = {limit}}}"""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One way in which a worker came to its end, and what was told of it."""

    library: str
    place: str
    end: str
    check: CheckRecord

    @property
    def true(self) -> bool:
        """Whether the line is the worker's own."""
        return bool(re.fullmatch(ENDS[self.end], self.check.decisive or ""))


def matrix(library: str, subject: Path) -> str:
    """The matrix of one library: every way to come to an end is a case."""
    python, requirements = LIBRARIES[library]
    api = library.partition(" ")[0]
    cases = (
        CASE.format(place=place, end=end, api=api, check=CHECK, limit=6 if end == "hang" else 60)
        for place, end in product(PLACES, ENDS)
    )
    asked = str(list(requirements)).replace("'", '"')
    return MATRIX.format(subject=subject.as_posix(), requirements=asked, python=python, cases=", ".join(cases))


def run(library: str, opened: store.Store) -> CellRecord:
    """Take the cell of a library through its cases, with a copy of the environments: nothing changes it."""
    settings = scheduler.Settings()
    with TemporaryDirectory() as folder, Progress(1, settings.jobs, headline) as board:
        subject = Path(folder) / "troubled"
        copytree(HERE / "environments", subject, ignore=ignore_patterns("__pycache__"))
        path = Path(folder) / f"masks-{library.replace(' ', '-')}.toml"
        path.write_text(matrix(library, subject), encoding="utf-8")
        (cell,) = catalog.dated(catalog.load(str(path), print), opened).cells
        (record,) = scheduler.run((cell,), opened, settings, board)
    return record


def seen(library: str, record: CellRecord) -> Iterator[Seen]:
    """Each case with what its check came to."""
    for step in (record.resolve, record.install):
        if step and step.decisive:
            sys.exit(f"{library}: {step.decisive}")
    for case in record.cases:
        place, _, end = case.case.partition("-")
        (check,) = [check for phase in case.phases for check in phase.checks if check.check == CHECK]
        yield Seen(library=library, place=place, end=end, check=check)


def render(found: Sequence[Seen]) -> str:
    """A row for each place and end: the decisive line, and what the parent saw, by library."""
    lines = []
    for place, end in product(PLACES, ENDS):
        row = [one for one in found if (one.place, one.end) == (place, end)]
        told = " / ".join(sorted({text(one.check.decisive or "", one.check.outcome.value) for one in row}))
        masks = (text(one.check.masked_by or "", "nothing for ever" if end == "hang" else "the same") for one in row)
        lines.append(f"| {PLACES[place]} | {end} | {told} | {' | '.join(masks)} |")
    libraries = list(dict.fromkeys(one.library for one in found))
    return "\n".join([
        "# What hides the end of a worker",
        "",
        f"{sum(one.true for one in found)} of {len(found)} decisive lines are the worker's own first exception, signal "
        "or exit code. Beside them what the process sees that waits for the worker: the mask, kept as `masked_by`.",
        "",
        f"Made by `python tests/real/masks.py` on {store.now()[:10]}, {machine.facts().id}: two workers of "
        "AsyncVectorEnv, start method fork. Whether it is `ConnectionResetError` or `BrokenPipeError` is a race.",
        "",
        f"| in | the worker | decisive line | {' | '.join(libraries)} |",
        f"| --- | --- | --- |{' --- |' * len(libraries)}",
        *lines,
        "",
    ])  # fmt: skip


def text(told: str, otherwise: str) -> str:
    """A line as a cell of a table has it."""
    return f"`{told.replace('|', '/')}`" if told else otherwise


def main(arguments: Sequence[str]) -> int:
    """Run; the whole table is written only when everything was run."""
    pattern = arguments[0] if arguments else "*"
    os.environ["HARNESS_CONTROLS"] = ""  # every case fails, and the adapters are not in doubt
    opened = store.open_store()
    chosen = [library for library in LIBRARIES if fnmatchcase(library, pattern)]
    found = [one for library in chosen for one in seen(library, run(library, opened))]
    for one in found:
        if not one.true:
            print(f"{one.library}, {one.end} in {PLACES[one.place]}: {one.check.decisive}", file=sys.stderr)
    if pattern == "*":
        (HERE / "masks.md").write_text(render(found), encoding="utf-8")
    else:
        print(render(found))
    return 0 if all(one.true for one in found) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

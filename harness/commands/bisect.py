"""`simmatrix bisect CELL --axis PACKAGE | --date | --python`: find the release, day or Python at which a cell broke."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from harness.commands import arguments, find_cell
from harness.judging.assess import assess
from harness.machine import interpreters, store
from harness.machine.store import Store
from harness.matrix import plan
from harness.model import Cell, Change, Interpreter, replace
from harness.model.cellid import CellId
from harness.model.errors import BadInput, CouldNotTell
from harness.model.schema import locate_errors
from harness.model.vocabulary import PackageName
from harness.probes import array_files
from harness.probes.vault import Vault
from harness.reports.answers import result_index
from harness.reports.text import progress
from harness.rootcause import search_documents
from harness.rootcause.bench import Bench, Bounds, BudgetExhausted, Trial
from harness.rootcause.bisection import candidates, certificates, guesses
from harness.rootcause.bisection.behaviour import BehaviourTask
from harness.rootcause.bisection.bisecting import Bisection, BisectionResult, Status, Task
from harness.rootcause.bisection.candidates import Candidate, Candidates, LineOptions
from harness.rootcause.bisection.certificates import BisectDocument
from harness.rootcause.repair import candidate_changes, pasting
from harness.running import behaviour_runs, open_matrix, scheduler
from harness.running.signatures import shipped_signatures
from harness.standalone import wrapping
from harness.standalone.failures.silent import plainly_good
from harness.standalone.output import print_json

HELP = (
    "Find the release, day or Python version at which a combination stopped working. Choose one line to search: the"
    " releases of a package (--axis), the state of the package index by date (--date), or the Pythons of this machine"
    " (--python). Both ends are measured first. Without --good, a working end is searched for."
)
CODES = {Status.FOUND: 0, Status.REFUSED: 1, Status.NO_GOOD_END: 1, Status.STOPPED: 3, Status.UNTOLD: 3}
DATE, PYTHON = "--date", "--python"
RUNS, MINUTES, CONFIDENCE = 60, 60.0, 0.99
COPIED = ("repeat it: ", "written: ")
HINTS = 2
"""Versions that were measured to work elsewhere, tried first where no good end is given."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bisect`."""
    parser.add_argument(
        "cell", metavar="CELL", help="id of a combination: of a matrix, or of an earlier `simmatrix try`"
    )
    along = parser.add_mutually_exclusive_group(required=True)
    along.add_argument("--axis", metavar="PACKAGE", help="search the releases of this package")
    along.add_argument(
        DATE, action="store_true", help="search days: all packages are resolved as the index stood on that day"
    )
    along.add_argument(PYTHON, action="store_true", help="search the Python versions of this machine")
    parser.add_argument("--good", metavar="V", help="a release, day or Python that works (default: searched for)")
    parser.add_argument(
        "--bad", metavar="V", help="a release, day or Python that fails (default: the combination as it is)"
    )
    parser.add_argument(
        "--behaves",
        action="store_true",
        help="find a change of behaviour instead of a failure: step from the same states as --good",
    )
    parser.add_argument(
        "--env", metavar="ID", help="the environment that --behaves compares, if the combination has several"
    )
    parser.add_argument("--any", action="store_true", help="treat any failure as bad, not just the original one")
    parser.add_argument("--yanked", action="store_true", help="include yanked releases")
    parser.add_argument("--pre", action="store_true", help="include pre-releases")
    parser.add_argument(
        "--runs", type=int, default=RUNS, metavar="N", help="measure at most N combinations (default: %(default)s)"
    )
    parser.add_argument(
        "--minutes", type=float, default=MINUTES, metavar="M", help="stop after M minutes (default: %(default)g)"
    )
    parser.add_argument(
        "--confidence",
        type=float,
        default=CONFIDENCE,
        metavar="P",
        help="repeat unreliable results until this probability is reached (default: %(default)g)",
    )
    arguments.offline(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write the certificate to this folder (default: .harness/bisects/...)"
    )
    parser.add_argument("--json", action="store_true", help="print the certificate as JSON on stdout, and nothing else")


@dataclass(frozen=True, kw_only=True, slots=True)
class BisectRequest:
    """A command line with the cell that it names."""

    args: argparse.Namespace
    opened: Store
    cell: Cell
    interpreter: Interpreter

    @property
    def axis(self) -> str:
        """Return the axis of the search: the name of a package, `--date` or `--python`."""
        return DATE if self.args.date else PYTHON if self.args.python else str(self.args.axis)

    @property
    def release_filter(self) -> LineOptions:
        """Return the settings for the releases to look at: yanked ones, pre-releases, offline."""
        return LineOptions(yanked=self.args.yanked, pre=self.args.pre, offline=self.args.offline)


def main(args: argparse.Namespace) -> int:
    """Search for the boundary, write the certificate, and return the exit code of its status (`CODES`)."""
    _check(args)
    opened = store.open_store()
    settings = scheduler.Settings(offline=args.offline)
    cell = find_cell.find("bisect", args.cell, opened, offline=args.offline)[1]
    behaves = None
    interpreter = interpreters.obtain(cell.python, offline=args.offline)
    if interpreter is None:
        raise CouldNotTell(interpreters.hint(cell.python))
    with (
        progress.SearchProgress(args.runs, args.minutes) as board,
        Bench(opened, settings, board, Bounds(runs=args.runs, minutes=args.minutes)) as bench,
    ):
        if args.behaves:
            cell, behaves = _behaviour(args, cell, opened, settings, bench.observer)
        request = BisectRequest(args=args, opened=opened, cell=cell, interpreter=interpreter)
        try:
            # --date needs the lock even where --bad is given: the days are those of uploads of its packages.
            base = bench.measure(cell, keep=not behaves) if args.date or not args.bad else None
        except BudgetExhausted as spent:
            message = f"{spent} before the combination itself was measured; raise --runs or --minutes"
            raise CouldNotTell(message) from None
        line, task = _task(request, base)
        search = Bisection(replace(task, behaves=behaves), bench, board.say)
        done = search.run()
        certificate = certificates.document(
            done, search, left_out=line.left_out, command=_repeat_command(request, done)
        )
    certificate = _write(certificate, done, args.out or _folder(request))
    if args.json:
        print_json(search_documents.as_json(certificate))
    else:
        print("\n".join(_wrapped(certificates.lines(certificate), wrapping.width(sys.stdout))))
    return CODES[done.status]


def _wrapped(lines: Iterable[str], columns: int | None) -> Iterator[str]:
    """Yield lines broken at the width of a terminal, but for commands and files, which people copy."""
    for line in lines:
        yield from [line] if line.startswith(COPIED) else wrapping.wrap(line, columns, 4 if line[:1] == " " else 2)


def _check(args: argparse.Namespace) -> None:
    if not 0.5 < args.confidence < 1:
        message = f"--confidence {args.confidence:g}: name a probability between 0.5 and 1, such as {CONFIDENCE:g}"
        raise BadInput(message)
    if args.runs < 1 or args.minutes <= 0:
        message = "--runs and --minutes: name a number above 0"
        raise BadInput(message)
    if args.behaves and (args.any or not args.good):
        message = "--behaves: name the end with the right behaviour by --good, and leave out --any"
        raise BadInput(message)
    if args.axis:
        with locate_errors("--axis"):
            args.axis = str(PackageName.canonical(args.axis))
    if args.out:
        store.writable(args.out)


def _behaviour(
    args: argparse.Namespace, cell: Cell, opened: Store, settings: scheduler.Settings, observer: scheduler.Observer
) -> tuple[Cell, BehaviourTask]:
    """Return the cell, to be stepped from a bank alone, and the task; the cell makes a bank if the case has none."""
    case, vault = behaviour_runs.case_of(cell, args.env), Vault(opened.folder)
    bank = case.bank
    if bank is None:
        bank = vault.keep(array_files.seal(behaviour_runs.make_bank(cell, case, opened, settings, observer)))
    stepping = behaviour_runs.stepping_cell(cell, case, bank)
    return stepping, BehaviourTask(env=str(case.env), bank=bank, vault=vault)


# --- the line and its ends -------------------------------------------------------------------------------------


def _task(request: BisectRequest, base: Trial | None) -> tuple[Candidates, Task]:
    """Return the line of candidates and the search on it. Raises BadInput if the line or its ends allow none."""
    args = request.args
    held = base.versions if base and base.lock else candidate_changes.pins(request.cell)
    line = _line(request, held)
    own = _name_unchanged(request, held)
    if args.bad is None and own is None:
        message = f"bisect {args.cell}: its lock does not contain {args.axis}; name the failing end with --bad"
        raise BadInput(message)
    if own is not None and args.bad is None:
        # The release of the cell may be missing on the line, as a yanked one is.
        line = _with_own(line, own)
    place = candidates.day if args.date else candidates.place
    bad = place(line, args.bad, "--bad") if args.bad else [one.name for one in line.candidates].index(str(own))
    good = place(line, args.good, "--good") if args.good else None
    if good == bad:
        message = f"--good and --bad are the same: {line.candidates[bad].name}"
        raise BadInput(message)
    if len(line.candidates) < 2:
        left_out = "; ".join(line.left_out)
        message = (
            f"bisect {args.cell}: there is nothing else to try along "
            f"{request.axis}{f'; {left_out}' if left_out else ''}"
        )
        raise BadInput(message)
    return line, Task(
        cell=request.cell,
        axis=request.axis,
        line=line.candidates,
        bad=bad,
        good=good,
        hints=tuple(_hints(request, line, bad, base)),
        any=args.any,
        confidence=args.confidence,
        recipes=open_matrix.recipes(Path("matrices")),
        base=base,
    )


def _line(request: BisectRequest, held: dict[str, str]) -> Candidates:
    cell, release_filter = request.cell, request.release_filter
    if request.args.python:
        return candidates.of_pythons(cell)
    if request.args.date:
        names = sorted({*held, *candidate_changes.asked_for(cell)})
        return candidates.of_days(cell, names, request.interpreter, release_filter)
    return candidates.of_package(cell, request.axis, request.interpreter, release_filter)


def _name_unchanged(request: BisectRequest, held: dict[str, str]) -> str | None:
    """Return the candidate name of the unchanged cell: its Python, its instant, or its version of the package."""
    if request.args.python:
        return request.interpreter.minor
    if request.args.date:
        return request.cell.question.snapshot or store.now()
    return held.get(request.axis)


def _with_own(line: Candidates, own: str) -> Candidates:
    """Return the line with the unchanged cell as one of its candidates, in order."""
    same = next((one for one in line.candidates if candidates.same(one.name, own)), None)
    mine = Candidate(name=own, change=Change(), uploaded=same.uploaded if same else None)
    others = [one for one in line.candidates if one is not same]
    return replace(
        line, candidates=tuple(sorted([*others, mine], key=lambda candidate: candidates.rank(candidate.name)))
    )


def _hints(request: BisectRequest, line: Candidates, bad: int, base: Trial | None) -> Iterator[int]:
    """Yield places where a good end may be: the first day, versions that worked elsewhere, versions by metadata."""
    if request.args.date:
        yield from [0] if bad else []
    elif not request.args.python:
        measured_places = {
            place for version in _working_versions(request) for place in candidates.places(line, version)
        }
        yield from sorted(measured_places - {bad}, key=lambda place: abs(place - bad))[:HINTS]
        if base:
            guessed_places = guesses.of_metadata(base, request.axis, line.candidates, offline=request.args.offline)
            yield from (place for place in guessed_places if place != bad)


def _working_versions(request: BisectRequest) -> Iterator[str]:
    """Yield versions of the package in working cells with the same environments, of this store and of reports."""
    envs = {case.env for case in request.cell.cases if case.env}
    knowledge = shipped_signatures.load_knowledge(request.opened.folder)
    for record in request.opened.cells():
        alike = envs & {case.env for case in record.cell.cases}
        if alike and record.installed:
            assessment = assess(record, knowledge)
            if plainly_good(assessment.verdict, assessment.unverified):
                yield record.installed.get(request.axis, "")
    before = result_index.load()
    for cell in before.cells:
        if cell.good and envs & {case.env for case in cell.cases}:
            yield dict(before.locks.get(cell.lock or "", ())).get(request.axis, "")


# --- what is left of it ----------------------------------------------------------------------------------------


def _repeat_command(request: BisectRequest, done: BisectionResult) -> str:
    """Return one command line that repeats the bisection."""
    args = request.args
    along = [request.axis] if request.axis in {DATE, PYTHON} else ["--axis", request.axis]
    ends = ["--good", done.line[0].name, "--bad", done.line[-1].name] if done.boundary else []
    flags = [f"--{name}" for name in ("behaves", "any", "yanked", "pre") if getattr(args, name)]
    flags += ["--env", args.env] if args.env else []
    sure = ["--confidence", f"{args.confidence:g}"] if args.confidence != CONFIDENCE else []
    words = shlex.join(["simmatrix", "bisect", args.cell, *along, *ends, *flags, *sure])
    # No matrix has a cell of `try`: whoever repeats the bisection has to try it first.
    tried = pasting.trying(request.cell) if request.cell.matrix == plan.TRY_MATRIX else None
    return f"{tried}; {words}" if tried else words


def _folder(request: BisectRequest) -> Path:
    args = request.args
    ends = [f"{side}-{value}" for side in ("good", "bad") if (value := getattr(args, side))]
    flags = [name for name in ("behaves", "any", "yanked", "pre") if getattr(args, name)]
    flags += [args.env] if args.env else []
    sure = [f"confidence-{args.confidence:g}"] if args.confidence != CONFIDENCE else []
    # Another question about the same cell has another folder, so no certificate replaces one that says something else.
    words = (f"along-{request.axis.strip('-')}", *ends, *flags, *sure)
    return request.opened.folder / "bisects" / CellId.parse(request.cell.id).folder(*words)


def _write(certificate: BisectDocument, done: BisectionResult, folder: Path) -> BisectDocument:
    """Write the certificate and the locks of both neighbours. Return the certificate with the paths of these files."""
    locks, sides = {}, {}
    for side, step in (("good", done.good), ("bad", done.bad)):
        entry = getattr(certificate, side)
        if step and entry and step.trial.lock:
            locks[f"{side}.lock.txt"] = step.trial.lock
            sides[side] = msgspec.structs.replace(entry, lock=f"{side}.lock.txt")
    certificate = msgspec.structs.replace(certificate, **sides)
    return search_documents.write(certificate, folder / "bisect", locks, certificates.page)

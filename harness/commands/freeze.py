"""`simmatrix freeze CELL`: write how an environment behaves to a file, and check later that it still does."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from harness.commands import find_cell
from harness.machine import store
from harness.machine.files import given_files, guarded_files
from harness.model import Cell
from harness.model.errors import BadInput
from harness.model.hostile_data import Unreadable
from harness.physics import sentences
from harness.physics.comparison import compare
from harness.physics.outputs import FORM, Bank, Outputs
from harness.physics.relation import Comparison
from harness.probes import array_files
from harness.probes.evidence import MOST_ARRAYS
from harness.probes.vault import Vault
from harness.reports.text import progress
from harness.running import behaviour_runs, scheduler
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Write how an environment behaves to a file (--out): states, the results of each step, and their rounding. Or check"
    " (--check) that a combination still behaves as such a file says."
)


class BehaviourCheck(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `freeze --check --json`. `kind` is the class of the relation, `start` that of the resets."""

    schema: int = 1
    cell: str
    env: str
    kind: str
    start: str
    stage: str | None
    text: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `freeze`."""
    parser.add_argument("cell", metavar="CELL", help="id of a combination, or a glob that matches one")
    parser.add_argument("--env", metavar="ID", help="the environment, if the combination has several")
    to = parser.add_mutually_exclusive_group(required=True)
    to.add_argument("--out", type=Path, metavar="FILE", help="write this file")
    to.add_argument(
        "--check", type=Path, metavar="FILE", help="compare with a file that `simmatrix freeze --out` wrote"
    )
    parser.add_argument(
        "--states-only", action="store_true", help="write only the states: for the key `bank` of a matrix"
    )
    parser.add_argument("--offline", action="store_true", help="never ask the package index")
    parser.add_argument(
        "--json", action="store_true", help="with --check: print one JSON document on stdout, and nothing else"
    )


def main(args: argparse.Namespace) -> int:
    """Write the file, or compare a cell with it."""
    frozen = read(args.check) if args.check else None
    opened = store.open_store()
    settings = scheduler.Settings(offline=args.offline)
    with progress.Progress(0, 1, progress.headline) as board:
        cell = find_cell.find("freeze", args.cell, opened, offline=args.offline)[1]
        if frozen is None:
            return _write(args, cell, opened, settings, board)
        bank, content = frozen
        case = behaviour_runs.case_of(cell, args.env or str(bank.facts["env"]))
        if case.env != bank.facts["env"]:
            message = f"{args.check}: was written for {bank.facts['env']}, not for {case.env}"
            raise BadInput(message)
        name = Vault(opened.folder).keep(content)
        arrays = behaviour_runs.step_from(cell, case, name, opened, settings, board)
    assert bank.outputs is not None
    difference = compare(bank.outputs, Outputs(arrays, array_files.facts(arrays)), bank)
    text = f"{case.env}: {sentences.describe(difference)}"
    if args.json:
        document = BehaviourCheck(
            cell=cell.id,
            env=str(case.env),
            kind=difference.kind,
            start=difference.start,
            stage=difference.stage,
            text=text,
        )
        print_json(msgspec.json.encode(document))
    else:
        print("\n".join(wrapping.wrap(text, wrapping.width(sys.stdout))))
    return exit_code(difference)


def exit_code(difference: Comparison) -> int:
    """Return 0 for the same behaviour, 1 for another one, 3 where that cannot be told."""
    return {False: 0, True: 1, None: 3}[difference.behaves_otherwise]


def _write(
    args: argparse.Namespace,
    cell: Cell,
    opened: store.Store,
    settings: scheduler.Settings,
    board: scheduler.Observer,
) -> int:
    case = behaviour_runs.case_of(cell, args.env)
    arrays = behaviour_runs.make_bank(cell, case, opened, settings, board)
    if args.states_only:
        arrays = {name: array for name, array in arrays.items() if not name.startswith("out.")}
    content = array_files.seal(arrays)
    given_files.write_content(args.out, content)
    print(f"{case.env}: {len(arrays['action'])} states, {len(content):,} bytes: {args.out}")
    return 0


def read(path: Path) -> tuple[Bank, bytes]:
    """Return the bank in a file and its content. Raises BadInput, saying what is wrong and what to do."""
    again = "write it again with `simmatrix freeze CELL --out FILE`"
    try:
        content = guarded_files.read(path, MOST_ARRAYS, follow=True)
        arrays = array_files.unseal(content)
        facts = array_files.facts(arrays)
    except Unreadable as error:
        message = f"{path}: {error}; {again}"
        raise BadInput(message) from None
    if facts.get("form") != FORM:
        message = (
            f"{path}: has format {facts.get('form')}, and this simmatrix reads format {FORM}; install a newer simmatrix"
        )
        raise BadInput(message)
    bank = Bank.of(arrays, facts)
    if bank.outputs is None:
        message = f"{path}: holds states only, without their results (--states-only); {again}"
        raise BadInput(message)
    return bank, content

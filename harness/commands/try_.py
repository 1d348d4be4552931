"""`simmatrix try REQUIREMENT...`: measure one combination, and answer in one line."""

from __future__ import annotations

import argparse
import sys

from harness.commands import ad_hoc_cell, arguments
from harness.judging.assess import assess
from harness.judging.exercised import unregistered_id
from harness.machine import store, this_machine
from harness.model import Verdict
from harness.model.errors import BadInput
from harness.reports import document, publishing
from harness.reports.text import progress
from harness.reports.text.try_answer import answer
from harness.running import scheduler
from harness.running.signatures import shipped_signatures
from harness.standalone import wrapping
from harness.standalone.output import print_json

HELP = (
    "Measure one combination of requirements: lock it, install it and run environments in it. Nothing of your own"
    " environment is changed."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `try`."""
    ad_hoc_cell.add_arguments(parser)
    parser.add_argument("--fresh", action="store_true", help="ignore earlier results: resolve and measure again")
    arguments.offline(parser)
    arguments.verify(parser)
    parser.add_argument("--json", action="store_true", help="print the report as JSON on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Try the combination. Return 0 only for `works`, 1 if it does not work, 3 if that cannot be decided here."""
    given = ad_hoc_cell.read(args)
    opened = store.open_store()
    settings = scheduler.Settings(fresh=args.fresh, offline=args.offline, verify=args.verify)
    with progress.Progress(1, 1, progress.headline) as board:
        planned = ad_hoc_cell.plan_cell(args, given, opened, scheduler.Runner(opened, settings, board))
        (record,) = scheduler.run(planned.cells, opened, settings, board)
    # Only the run shows that nothing registers an id. A mistyped id is bad input and no fact about packages.
    wrong = unregistered_id(record)
    if wrong:
        raise BadInput(wrong)
    knowledge = shipped_signatures.load_knowledge(opened.folder)
    assessed = assess(record, knowledge)
    if args.json:
        here = this_machine.facts()
        locate = publishing.seen_from_here(opened.folder)
        facts = {here.id: here.facts}
        used = publishing.probes(planned)
        report = document.build([record], [planned], facts, store.now(), locate, used, knowledge=knowledge)
        print_json(document.encode(report))
    else:
        columns = wrapping.width(sys.stdout)
        first, *others = answer(assessed).splitlines()
        print("\n".join([*wrapping.wrap(first, columns), *wrapping.wrap_lines(others, columns)]))
    return 0 if assessed.verdict is Verdict.WORKS else 3 if assessed.untold else 1

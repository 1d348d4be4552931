"""`simmatrix upgrade REQUIREMENT...`: foresee an upgrade of the environment at hand from measured results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports.answers import misspelt, result_index
from harness.reports.projects import project, upgraded, upgraded_text
from harness.reports.projects.project import Project
from harness.reports.projects.upgraded import Move
from harness.standalone import wrapping
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.installing import installer
from harness.standalone.output import print_json

HELP = (
    "Foresee an upgrade of the environment at hand: would it install, run, behave and look the same; the newest"
    " release that changes nothing; the command. Exit status 1: something fails or changes; 3: not measured."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `upgrade`."""
    parser.add_argument("requirements", metavar="REQUIREMENT", nargs="+", help="mujoco, or mujoco==3.9.0")
    parser.add_argument("-r", dest="files", type=Path, metavar="FILE", action="append", default=[],
                        help="a requirement file in place of the environment at hand")  # fmt: skip
    parser.add_argument("--python", metavar="V|PATH", help="another environment; or the Python of the files")
    parser.add_argument("--env", metavar="ID", help="only this environment, such as Ant-v5")
    parser.add_argument("--try", dest="measure", action="store_true",
                        help="measure in a copy what no table holds: a task has to be named with --env")  # fmt: skip
    parser.add_argument("--all", action="store_true", help="name every task and every release")
    parser.add_argument("--offline", action="store_true", help="never ask the index")
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def main(args: argparse.Namespace) -> int:
    """Print what is known of the upgrade, and return the exit code."""
    here = project.read_files(args.files, (), (), args.python) if args.files else project.read_environment(args.python)
    measured = result_index.load()
    moves = [_move(text, here, measured, offline=args.offline) for text in args.requirements]
    document = upgraded.upgrade(measured, here, moves, _command(here, moves), args.env)
    if args.json:
        print_json(msgspec.json.encode(document))
    else:
        texts = upgraded_text.lines(document, whole=args.all)
        print("\n".join(wrapping.wrap_lines(texts, wrapping.width(sys.stdout))))
    return upgraded.exit_code(document)


def _move(text: str, here: Project, measured: Measured, *, offline: bool) -> Move:
    try:
        move = upgraded.target(text, here, measured)
    except ValueError as error:
        misspelt.check([text], lambda line: print(line, file=sys.stderr), offline=offline)
        message = f"upgrade: {error}"
        raise BadInput(message) from None
    history = load_shipped(move.name)
    if history is None or move.then not in history.versions:
        misspelt.check([f"{move.name}=={move.then}"], lambda line: print(line, file=sys.stderr), offline=offline)
    return move


def _command(here: Project, moves: Sequence[Move]) -> tuple[str, ...]:
    """Return the command that does the upgrade; of files, the lines to write."""
    pins = [f"{move.name}=={move.then}" for move in moves]
    if here.interpreter is None:
        return tuple(pins)
    return installer(here.interpreter, here.packages).installing(pins)

"""`simmatrix upgrade REQUIREMENT...`: foresee an upgrade of the environment at hand from measured results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from harness.commands import environment_at_hand
from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports.answers import result_index
from harness.reports.projects import project, unknown_names, upgrade_document, upgraded, upgraded_text
from harness.reports.projects.labelled_lines import wrap_labelled
from harness.reports.projects.project import Project
from harness.reports.projects.tried_task import TriedTask
from harness.reports.projects.upgrade_document import Move, Upgraded
from harness.standalone import wrapping
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.installing import installer
from harness.standalone.output import print_json

HELP = (
    "Predict what an upgrade would change in the active environment: does it install, run, behave the same and look"
    " the same? Also name the newest release that changes nothing, and the command that installs it."
)


MOST = 3
"""Tasks that `--try` measures where none is named."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `upgrade`."""
    parser.add_argument(
        "requirements",
        metavar="REQUIREMENT",
        nargs="+",
        help="a package (its newest release), or one release such as mujoco==3.9.0",
    )
    parser.add_argument("-r", dest="files", type=Path, metavar="FILE", action="append", default=[],
                        help="a requirement file instead of the active environment; may be repeated")  # fmt: skip
    parser.add_argument(
        "--python", metavar="V|PATH", help="with -r: the Python version; without: the environment to upgrade"
    )
    parser.add_argument("--env", metavar="ID", help="only results of this environment, such as Ant-v5")
    parser.add_argument("--try", dest="measure", action="store_true",
                        help="measure missing results in a copy of the environment: the one of --env, or up to "
                             f"{MOST}")  # fmt: skip
    parser.add_argument("--all", action="store_true", help="list every environment and every release")
    parser.add_argument("--offline", action="store_true", help="never ask the package index")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Print what is known of the upgrade, and return the exit code."""
    here = (
        project.read_files(args.files, (), (), args.python)
        if args.files
        else environment_at_hand.read_environment(args.python)
    )
    measured = result_index.load()
    unknown_names.refuse_environment(args.env, measured)
    moves = [_move(text, here, measured, offline=args.offline) for text in args.requirements]
    document = upgraded.upgrade(measured, here, moves, _command(here, moves), args.env)
    if args.measure:
        document = msgspec.structs.replace(document, tried=tuple(_tried(here, document, args)))
    if args.json:
        print_json(msgspec.json.encode(document))
    else:
        texts = [*upgraded_text.lines(document, whole=args.all), *upgraded_text.tried_lines(document)]
        print("\n".join(wrap_labelled(texts, wrapping.width(sys.stdout), upgraded_text.WIDTH)))
    return upgrade_document.exit_code(document)


def _tried(here: Project, document: Upgraded, args: argparse.Namespace) -> list[TriedTask]:
    """Measure the task that is named, else some that were not measured, in copies. Raises BadInput, CouldNotTell."""
    from harness.rootcause.doctor import upgrade_in_copy  # noqa: PLC0415 - start-up

    unmeasured = [*document.behaviour.unmeasured, *document.tasks]
    envs = [args.env] if args.env else list(dict.fromkeys(unmeasured))[:MOST]
    if not envs:
        message = "upgrade --try: no environment is known that uses it; name one with --env ID"
        raise BadInput(message)
    versions = {name: each.pinned for name, each in here.packages.items() if each.pinned}
    python = here.interpreter or str(here.python or "host")
    moves = {move.name: move.then for move in document.moves}
    return upgrade_in_copy.try_upgrade(python, versions, moves, envs, offline=args.offline)


def _move(text: str, here: Project, measured: Measured, *, offline: bool) -> Move:
    try:
        move = upgraded.target(text, here, measured)
    except ValueError as error:
        _refuse_unknown(text, offline=offline)
        message = f"upgrade: {error}"
        raise BadInput(message) from None
    history = load_shipped(move.name)
    if history is None or move.then not in history.versions:
        _refuse_unknown(f"{move.name}=={move.then}", offline=offline)
    return move


def _refuse_unknown(text: str, *, offline: bool) -> None:
    """Refuse a requirement that the index cannot serve. Raises BadInput."""
    from harness.reports.answers import misspelt  # noqa: PLC0415 - start-up

    misspelt.check([text], lambda line: print(line, file=sys.stderr), offline=offline)


def _command(here: Project, moves: Sequence[Move]) -> tuple[str, ...]:
    """Return the command that does the upgrade; of files, the lines to write."""
    pins = [f"{move.name}=={move.then}" for move in moves]
    if here.interpreter is None:
        return tuple(pins)
    return installer(here.interpreter, here.packages).installing(pins)

"""`simmatrix recommend PACKAGE...`: name versions that were measured to work together."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from packaging.version import InvalidVersion, Version

from harness.model import Phase
from harness.model.errors import BadInput
from harness.model.measured import Measured
from harness.reports.answers import measured_cells, recommended_text, result_index
from harness.reports.answers.measured_cells import CellResult, Query, Wanted
from harness.reports.answers.recommended import Recommended, build_answer
from harness.reports.answers.recommending import Combination
from harness.reports.install_texts import install_commands
from harness.standalone.output import print_json

if TYPE_CHECKING:
    from harness.running import lock_files

HELP = (
    "Recommend versions that were measured together and work: the newest such combination, the command that installs"
    " it, and known problems with these packages."
)
COMMANDS = (install_commands.PIP, install_commands.UV)
FORMATS = (*COMMANDS, "conda", "pyproject", "dockerfile")

SHOWN = 5
NEEDS = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER, Phase.INTEROP)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `recommend`."""
    parser.add_argument(
        "packages", metavar="PACKAGE", nargs="+", help="a package, or a requirement such as 'gymnasium>=1'"
    )
    parser.add_argument("--python", metavar="V", help="only combinations of this Python, such as 3.11 (default: any)")
    parser.add_argument("--needs", type=_phases, default=(), metavar="PHASE,...",
                        help=f"phases that must have passed: {', '.join(NEEDS)}; separate with commas")  # fmt: skip
    parser.add_argument("--env", metavar="ID", help="an environment that must have been tried, such as Ant-v5")
    parser.add_argument("--format", choices=FORMATS, default=install_commands.PIP, metavar="TOOL",
                        help=f"print a command or file for this tool: {', '.join(FORMATS)} (default: pip)")  # fmt: skip
    parser.add_argument(
        "--limit", type=int, default=SHOWN, metavar="N", help=f"number of combinations in --json (default: {SHOWN})"
    )
    parser.add_argument("--all", action="store_true", help="show every combination and every known problem")
    parser.add_argument("--lock-out", type=Path, metavar="FILE",
                        help="write the lock of the first combination, with its patched wheels next to it")  # fmt: skip
    parser.add_argument(
        "--offline", action="store_true", help="do not ask the package index whether unknown packages exist"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def _phases(text: str) -> tuple[Phase, ...]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in NEEDS]
    if unknown or not names:
        message = f"unknown phase {(unknown or [text])[0]!r}; choose from {', '.join(NEEDS)}"
        raise argparse.ArgumentTypeError(message)
    return tuple(Phase(name) for name in dict.fromkeys(names))


def main(args: argparse.Namespace) -> int:
    """Print the combinations that were measured. Return 0 if one of them works, else 1."""
    query = _query(args)
    measured = result_index.load()
    cells = measured_cells.read(measured)
    _check(cells, query, offline=args.offline)
    trying = recommended_text.try_command([one.text for one in query.wanted], query.python, query.env)
    limit = len(cells) if args.all else max(args.limit, 1)
    answer = build_answer(cells, query, limit, trying)
    best = next(iter(answer.measured), None)
    if args.lock_out:
        _write(args.lock_out, best, query, offline=args.offline)
    if args.json:
        print_json(msgspec.json.encode(answer))
    elif args.format not in COMMANDS and best:
        print(_file(best, args, measured), end="")
    else:
        # A file that is asked for holds nothing else: where there is none, the reasons are no part of it.
        out = sys.stdout if args.format in COMMANDS else sys.stderr
        print("\n".join(_lines(answer, args, measured, cells)), file=out)
    return 0 if answer.measured else 1


def _lines(answer: Recommended, args: argparse.Namespace, measured: Measured, cells: Sequence[CellResult]) -> list[str]:
    """Return the answer in words."""
    # Only the names of unknown packages are compared with all others.
    names = {name for one in cells for name in one.about} if answer.unknown else set()
    width = shutil.get_terminal_size().columns
    tool = args.format if args.format in COMMANDS else install_commands.PIP
    lines = recommended_text.lines(answer, measured.machines, names, width, tool, whole=args.all)
    if not args.all:
        return lines
    from harness.reports.answers import recommended_details  # noqa: PLC0415 - start-up

    return lines + recommended_details.lines(answer, measured.machines, width, tool)


def _file(best: Combination, args: argparse.Namespace, measured: Measured) -> str:
    """Return a combination as a file of a tool. Raises BadInput if no index has what it needs."""
    from harness.reports.install_texts import environment_files  # noqa: PLC0415 - start-up
    from harness.running import lock_files  # noqa: PLC0415 - start-up

    lock = args.lock_out if args.format == "dockerfile" else None
    missing = [*best.brought, *(() if lock else best.repaired)]
    if missing:
        hint = "; --lock-out FILE writes it, too" if best.repaired else ""
        message = f"recommend --format {args.format}: no index has {', '.join(missing)} as it was measured{hint}"
        raise BadInput(message)
    header = lock_files.header(_handed(best))
    if args.format == "dockerfile":
        os = str(measured.machines.get(best.machine, {}).get("os", ""))
        return environment_files.dockerfile(best, header, os, lock)
    write = {"conda": environment_files.conda, "pyproject": environment_files.pyproject}[args.format]
    return write(best, header)


def _query(args: argparse.Namespace) -> Query:
    wanted: dict[str, Wanted] = {}
    try:
        for text in args.packages:
            requirement = Wanted.of(text)
            if requirement.name in wanted:
                message = f'"{requirement.name}" is named twice; write `{requirement.name}>=1,<2`'
                raise ValueError(message)
            wanted[requirement.name] = requirement
        if args.python is not None:
            Version(args.python)
    except InvalidVersion:
        message = f'recommend: --python "{args.python}" is not a version; write one such as 3.11'
        raise BadInput(message) from None
    except ValueError as error:
        message = f"recommend: {error}"
        raise BadInput(message) from None
    return Query(wanted=tuple(wanted.values()), python=args.python, needs=args.needs, env=args.env)


def _check(cells: Sequence[CellResult], query: Query, *, offline: bool) -> None:
    """Refuse packages and releases that no index has, without asking for measured ones. Raises BadInput."""
    unseen = [one for one in query.wanted if not any(one.fits(cell.versions.get(one.name)) for cell in cells)]
    if unseen:
        from harness.reports.answers import misspelt  # noqa: PLC0415 - start-up

        misspelt.check([one.text for one in unseen], lambda text: print(text, file=sys.stderr), offline=offline)


def _write(path: Path, best: Combination | None, query: Query, *, offline: bool) -> None:
    if best is None:
        print(
            f"recommend: no working combination of {' '.join(query.names)} was measured; no lock was written",
            file=sys.stderr,
        )
        return
    if not best.lock:
        print(f"recommend: the lock of {best.cell} was not kept; no lock was written", file=sys.stderr)
        return
    from harness.running import lock_files  # noqa: PLC0415 - start-up

    command = lock_files.write(path, _handed(best), offline=offline)
    print(f"lock: {path}, of {best.cell}\ninstall: {command}", file=sys.stderr)


def _handed(best: Combination) -> lock_files.MeasuredLock:
    """Return the lock of a combination, with what its header says."""
    from harness.running import lock_files  # noqa: PLC0415 - start-up

    return lock_files.MeasuredLock(
        lock=best.lock,
        cell=best.cell,
        python=best.python,
        machine=best.machine,
        measured=best.measured,
        settings=install_commands.variables(best),
    )

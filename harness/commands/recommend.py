"""`simmatrix recommend PACKAGE...`: name versions that were measured to work together."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
from packaging.version import InvalidVersion, Version

from harness.model import Phase
from harness.model.errors import BadInput
from harness.reports.answers import measured_cells, misspelt, recommended_text, result_index
from harness.reports.answers.measured_cells import CellResult, Query, Wanted
from harness.reports.answers.recommended import build_answer
from harness.reports.answers.recommending import Combination
from harness.standalone.output import print_json

HELP = "Which versions work together: the newest combination that was measured and found good, and known traps."

SHOWN = 5
NEEDS = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER, Phase.INTEROP)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `recommend`."""
    parser.add_argument("packages", metavar="PACKAGE", nargs="+", help="name or requirement: mujoco, 'gymnasium>=1'")
    parser.add_argument("--python", metavar="V", help="such as 3.11 [any]")
    parser.add_argument("--needs", type=_phases, default=(), metavar="PHASE,...",
                        help=f"what has to have passed, of {', '.join(NEEDS)}")  # fmt: skip
    parser.add_argument("--env", metavar="ID", help="an environment that has to have been tried")
    parser.add_argument("--limit", type=int, default=SHOWN, metavar="N", help=f"combinations in --json [{SHOWN}]")
    parser.add_argument("--all", action="store_true", help="show every combination and every trap")
    parser.add_argument("--lock-out", type=Path, metavar="FILE",
                        help="write the lock of the first one, and its patched wheels next to it")  # fmt: skip
    parser.add_argument("--offline", action="store_true", help="never ask the index whether a package exists")
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def _phases(text: str) -> tuple[Phase, ...]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in NEEDS]
    if unknown or not names:
        message = f"{(unknown or [text])[0]!r} is none of {', '.join(NEEDS)}"
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
    if args.lock_out:
        _write(args.lock_out, next(iter(answer.measured), None), query, offline=args.offline)
    if args.json:
        print_json(msgspec.json.encode(answer))
    else:
        names = {name for one in cells for name in one.about}
        width = shutil.get_terminal_size().columns
        print("\n".join(recommended_text.lines(answer, measured.machines, names, width, whole=args.all)))
    return 0 if answer.measured else 1


def _query(args: argparse.Namespace) -> Query:
    wanted: dict[str, Wanted] = {}
    try:
        for text in args.packages:
            requirement = Wanted.of(text)
            if requirement.name in wanted:
                message = f'"{requirement.name}" is asked for twice; write `{requirement.name}>=1,<2`'
                raise ValueError(message)
            wanted[requirement.name] = requirement
        if args.python is not None:
            Version(args.python)
    except InvalidVersion:
        message = f'recommend: --python "{args.python}" is no version such as 3.11'
        raise BadInput(message) from None
    except ValueError as error:
        message = f"recommend: {error}"
        raise BadInput(message) from None
    return Query(wanted=tuple(wanted.values()), python=args.python, needs=args.needs, env=args.env)


def _check(cells: Sequence[CellResult], query: Query, *, offline: bool) -> None:
    """Refuse packages and releases that no index has, without asking for measured ones. Raises BadInput."""
    unseen = [one for one in query.wanted if not any(one.fits(cell.pins.get(one.name)) for cell in cells)]
    misspelt.check([one.text for one in unseen], lambda text: print(text, file=sys.stderr), offline=offline)


def _write(path: Path, best: Combination | None, query: Query, *, offline: bool) -> None:
    if best is None:
        print(f"recommend: nothing good was measured of {' '.join(query.names)}: no lock was written", file=sys.stderr)
        return
    from harness.running import lock_files  # noqa: PLC0415 - start-up

    handed = lock_files.MeasuredLock(
        lock=best.lock,
        cell=best.cell,
        python=best.python,
        machine=best.machine,
        measured=best.measured,
        # `virtual` is our own word for a display, and nothing that a user could set.
        settings={name: value for name, value in best.settings.items() if (name, value) != recommended_text.VIRTUAL},
    )
    command = lock_files.write(path, handed, offline=offline)
    print(f"lock: {path}, of {best.cell}\ninstall: {command}", file=sys.stderr)

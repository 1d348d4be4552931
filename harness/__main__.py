"""The command line: parse, dispatch to one module per verb, turn errors into messages and exit codes."""

from __future__ import annotations

import argparse
import errno
import gc
import importlib
import os
import shutil
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import harness
from harness.errors import CouldNotTell, HarnessError

VERBS = {
    "plan": ("harness.commands.plan", "list the cells of a matrix, and what was dropped and why"),
    "lock": ("harness.commands.lock", "resolve every cell to hash-pinned requirements"),
    "run": ("harness.commands.run", "lock, build, install, probe and report every cell of a matrix"),
    "try": ("harness.commands.try_", "try one combination of requirements"),
    "report": ("harness.commands.report", "tables from stored results"),
    "show": ("harness.commands.show", "everything known of one cell"),
    "merge": ("harness.commands.merge", "the reports of shards and machines as one"),
    "accept": ("harness.commands.accept", "write expectations for what is red now"),
    "ci": ("harness.commands.ci", "a workflow for GitHub, GitLab or Slurm that runs a matrix"),
    "init": ("harness.commands.init", "start in somebody's project: matrix, nox session, workflow"),
    "fetch": ("harness.commands.fetch", "bring all that a matrix needs into a folder, for machines without network"),
    "explain": ("harness.commands.explain", "why something failed, from what it wrote, or around a command"),
    "doctor": ("harness.commands.doctor", "what is wrong with an environment, and the nearest known-good"),
    "recommend": ("harness.commands.recommend", "which versions work together, as measured"),
    "repair": ("harness.commands.repair", "the smallest change that turns a red cell green, proven by a rerun"),
    "bisect": ("harness.commands.bisect", "the release, day or Python at which a cell broke"),
    "gc": ("harness.commands.gc", "remove what is old or too much from cache and state"),
    "schema": ("harness.commands.schema_", "JSON Schemas of matrix files and of every document"),
}
"""Verb: module and one line of help. A module is imported only when its verb is used."""

SHORTAGES = frozenset(
    getattr(errno, f"E{name}")
    for name in ("NOSPC", "DQUOT", "ROFS", "IO", "ACCES", "PERM", "MFILE", "NFILE", "NOMEM", "AGAIN")
)
"""What the system answers when it is full, broken, forbids something or has too little left: no bug of ours."""

INTERRUPTED = 130
TERMINATED = 143


GARBAGE = 50_000
"""Objects made before Python looks for circles among them: records are many and hold none."""


def console() -> None:
    """Entry point of the installed commands."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # it was closed by whoever started us
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - to the end
    sys.exit(main(sys.argv[1:]))


def main(arguments: Sequence[str]) -> int:
    """Run one verb and return the exit code of the contract."""
    signal.signal(signal.SIGTERM, _terminate)
    gc.set_threshold(GARBAGE)
    try:
        verb, rest = _verb(arguments)
        module = _imported(VERBS[verb][0])
        parser = argparse.ArgumentParser(prog=f"simmatrix {verb}", description=module.HELP)
        module.add_arguments(parser)
        code = int(module.main(_parsed(module, parser, rest)))
        print(end="", flush=True)  # what cannot be written any more is known here, not when Python ends
        return code
    except HarnessError as error:
        print(f"simmatrix: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("simmatrix: interrupted; finished cells are kept, the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    except _Terminated:
        print("simmatrix: terminated; finished cells are kept, the same command goes on from there", file=sys.stderr)
        return TERMINATED
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _unforeseen(error)


def _parsed(module: Any, parser: argparse.ArgumentParser, rest: Sequence[str]) -> argparse.Namespace:
    """The arguments; where a verb takes a command after `--`, that is no argument of ours, and stays as it is."""
    if not hasattr(module, "split"):
        return parser.parse_args(rest)
    ours, command = module.split(rest)
    return parser.parse_args(ours, argparse.Namespace(after=command))


def _unforeseen(error: Exception) -> int:
    """Tell a machine that is short of something from a bug of ours."""
    if isinstance(error, shutil.Error) or (isinstance(error, OSError) and error.errno in SHORTAGES):
        print(f"simmatrix: this machine got in the way: {error}; mend that and type the same again", file=sys.stderr)
        return CouldNotTell.exit_code
    import traceback  # noqa: PLC0415 - start-up

    traceback.print_exception(error)
    print("simmatrix: this is a bug of simmatrix, not of the packages; please report it", file=sys.stderr)
    return HarnessError.exit_code


class _Terminated(BaseException):
    """SIGTERM, raised in the main thread so that `with` blocks end what they started."""


def _terminate(number: int, frame: FrameType | None) -> None:
    raise _Terminated


def _imported(name: str) -> Any:
    """A module; what importing it makes lives to the end, so that looking for garbage in it is a waste of time."""
    if name in sys.modules:
        return sys.modules[name]
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.enable()
        gc.freeze()


def _verb(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    lines = "\n".join(f"  {name:<8} {text}" for name, (_, text) in VERBS.items())
    parser = argparse.ArgumentParser(
        prog="simmatrix",
        description=harness.__doc__,
        epilog=f"verbs:\n{lines}\n\n`simmatrix VERB --help` tells the rest.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="simmatrix VERB [...]",
    )
    parser.add_argument("verb", metavar="VERB", help=argparse.SUPPRESS)
    verb = str(parser.parse_args(arguments[:1]).verb)
    if verb not in VERBS:
        from difflib import get_close_matches  # noqa: PLC0415 - start-up

        near = get_close_matches(verb, VERBS, n=1)
        parser.error(f'there is no verb "{verb}"' + (f'; did you mean "{near[0]}"?' if near else ""))
    return verb, arguments[1:]


if __name__ == "__main__":
    console()

"""Run the verb `explain`: on a file, on stdin, or around a command."""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import sys
import tempfile
from typing import Any, Callable, List, Mapping, NamedTuple, Optional, Sequence, TextIO, Tuple

from .. import packages, wrapping
from ..installing import installer
from ..matching import Known
from ..opening import opened
from ..packages import Packages
from ..requirements import requirement
from . import explaining, keeping, wording
from .explaining import Explained, Here
from .keeping import Kept
from .wording import Place

UNKNOWN, BAD, INTERRUPTED = 1, 2, 130
PINNED = re.compile(r"[A-Za-z0-9][\w.\[\],-]*\s*[=<>~!]")
HELP = (
    "Explain a failure from what was written of it: cause, remedy, reference, and what to type next. A FILE, or - for"
    " stdin; or, after --, a command, which is run as it stands, and explained where it fails. Exits with 1 where the"
    " cause is unknown; around a command with the command's own code."
)


class Bad(Exception):
    """Raised for arguments or files that cannot be used; the message says what to do."""


class Knowledge(NamedTuple):
    """Reference data for failures, read only when there is one: known failures and measured results."""

    known: Callable[[], Sequence[Known]]
    measured: Callable[[], Optional[Mapping[str, Any]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `explain` to a parser."""
    parser.usage = (
        "%(prog)s [--python PATH] [--json] [FILE | -]\n       %(prog)s [--python PATH] [--json] -- COMMAND..."
    )
    parser.add_argument("file", metavar="FILE", nargs="?", help="a log, traceback or notebook's output; - for stdin")
    parser.add_argument("--python", metavar="PATH", help="the interpreter, or environment, that it failed in")
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def split(arguments: Sequence[str]) -> Tuple[List[str], Optional[List[str]]]:
    """Split the arguments into our own and the command after `--`; the command is None without `--`."""
    if "--" not in arguments:
        return list(arguments), None
    place = list(arguments).index("--")
    return list(arguments[:place]), list(arguments[place + 1 :])


def of_text(args: argparse.Namespace, knowledge: Knowledge, place: Place) -> int:
    """Explain a file or stdin. Raises Bad."""
    kept = _read(args.file)
    if not kept.text.strip():
        message = "explain: {} is empty; give the whole output of what failed".format(_called(args.file))
        raise Bad(message)
    around = _around(args.python, ()) if args.python else None
    here = _here(around, knowledge)
    made = _with_missing(explaining.explained(kept.text, knowledge.known(), here), kept)
    if args.json:
        print(json.dumps(made.plain()))
    else:
        _print(made, _placed(place, around, ()), sys.stdout)
    return 0 if made.cause is not None else UNKNOWN


def of_command(args: argparse.Namespace, command: Sequence[str], knowledge: Knowledge, place: Place) -> int:
    """Run a command, and explain it where it fails; `place.kept` is the file that its output goes to. Raises Bad."""
    from . import spawning  # noqa: PLC0415 - Windows lacks what it needs

    if not command:
        message = "explain: names no command after --"
        raise Bad(message)
    if os.name == "nt":
        message = "explain: cannot run a command on Windows; redirect its output into a file (2>&1), and give that"
        raise Bad(message)
    if args.file is not None:
        message = "explain: a FILE or a command, not both: {} stands before --".format(args.file)
        raise Bad(message)
    around = _around(args.python, command)
    path = place.kept or _temporary()
    with open(path, "wb") as log:
        ended = spawning.run(command, log, apart=args.json)
    if ended.code == 0:
        os.unlink(path)
        return _unexplained(args, ended.code, None)
    if ended.trouble:
        os.unlink(path)
        return _unexplained(args, ended.code, ended.trouble)
    if ended.code == INTERRUPTED:
        return _unexplained(args, ended.code, "interrupted; what it wrote is in {}".format(path))
    with open(path, "rb") as written:
        kept = keeping.kept(written.read)
    asked = _asked(command)
    here = _here(around, knowledge)._replace(failed=True, signal=ended.signal, asked=asked)
    made = _with_end(_with_missing(explaining.explained(kept.text, knowledge.known(), here), kept), ended.code)
    if args.json:
        print(json.dumps(made.plain()))
    place = _placed(place, around, asked)._replace(command=tuple(command), kept=path)
    _print(made, place, sys.stderr, "\nexplain: {} failed: {}".format(os.path.basename(command[0]), _end(ended)))
    return ended.code


def _unexplained(args: argparse.Namespace, code: int, why: Optional[str]) -> int:
    """Report why there is nothing to explain, and return the command's exit code."""
    if why:
        print("explain: {}".format(why), file=sys.stderr)
    if args.json:
        print(json.dumps({"schema": 1, "decisive": why, "phase": None, "diagnoses": [], "findings": []}))
    return code


def _placed(place: Place, around: Optional[Packages], asked: Tuple[str, ...]) -> Place:
    """Return the place with the environment and the requirements of the same combination.

    These are the requirements asked for, else the installed packages that matter.
    """
    if around is None:
        return place._replace(asked=asked)
    return place._replace(
        python=around.python,
        version=around.version,
        asked=asked or tuple(wording.subjects(around.installed)),
        installer=installer(around.python, around.installed or None),
    )


def _asked(command: Sequence[str]) -> Tuple[str, ...]:
    """Return the requirements with versions that an installer's command line names."""
    if "install" not in command and "compile" not in command:
        return ()
    return tuple(word for word in command if PINNED.match(word) and _is_requirement(word))


def _is_requirement(word: str) -> bool:
    try:
        return bool(requirement(word).specifiers)
    except ValueError:
        return False


def _end(ended: Any) -> str:
    return "killed by {}".format(ended.signal) if ended.signal else "exit code {}".format(ended.code)


def _print(made: Explained, place: Place, stream: TextIO, *before: str) -> None:
    text = "\n".join([*before, *wrapping.wrapped(wording.lines(made, place), wrapping.width(stream))])
    encoding = getattr(stream, "encoding", None) or "utf-8"
    print(text.encode(encoding, "replace").decode(encoding), file=stream, flush=True)


def _with_missing(made: Explained, kept: Kept) -> Explained:
    if not kept.missing:
        return made
    text = "{:.1f} of {:.1f} MB were left out: looked at are the beginning, the end, and each traceback once".format(
        kept.missing / 1e6, kept.size / 1e6
    )
    return made._replace(findings=(*made.findings, ("left out", "note", text)))


def _with_end(made: Explained, code: int) -> Explained:
    """Use the command's exit code as decisive line if its output has none."""
    if made.told.decisive:
        return made
    line = "exited with code {} without a word".format(code) if code < 128 else "killed without a word"
    return made._replace(told=made.told._replace(decisive=line))


# --- what is read ----------------------------------------------------------------------------------------------


def _called(file: Optional[str]) -> str:
    return "stdin" if file in {None, "-"} else str(file)


def _read(file: Optional[str]) -> Kept:
    if file is None and sys.stdin is not None and sys.stdin.isatty():
        message = "explain: give a FILE, a text on stdin, or a command after --"
        raise Bad(message)
    if file in {None, "-"}:
        return keeping.kept(sys.stdin.buffer.read if sys.stdin else io.BytesIO().read)
    try:
        with opened(str(file)) as stream:
            return keeping.kept(stream.read)
    except OSError as error:
        message = "explain: {}: cannot be read: {}".format(file, error.strerror)
        raise Bad(message) from None


def _around(python: Optional[str], command: Sequence[str]) -> Optional[Packages]:
    """Return the packages of the interpreter that `python` names, or that the command runs. Raises Bad."""
    folder = os.getcwd()
    if python is None:
        return packages.of_command(command, os.environ, folder)
    found = packages.of_interpreter(python, os.environ, folder)
    if found is None:
        message = (
            "explain --python {}: no Python lies there; name an interpreter or the folder of an environment".format(
                python
            )
        )
        raise Bad(message)
    return found


def _here(around: Optional[Packages], knowledge: Knowledge) -> Here:
    installed, python = (around.installed, around.version) if around and around.installed else (None, None)
    return Here(installed=installed, python=python, measured=knowledge.measured())


def _temporary() -> str:
    descriptor, path = tempfile.mkstemp(prefix="simmatrix-explain-", suffix=".log")
    os.close(descriptor)
    return path

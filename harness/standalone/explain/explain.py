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
from ..failures.matching import Signature
from ..installing import installer
from ..opening import open_file
from ..packages import Packages
from ..requirements import requirement
from . import explanation_text, log_excerpt
from .api_history import load_shipped
from .explain_text import Explanation, Facts, explain_text
from .explanation_text import Place
from .log_excerpt import Excerpt

UNKNOWN, BAD, INTERRUPTED = 1, 2, 130
PINNED = re.compile(r"[A-Za-z0-9][\w.\[\],-]*\s*[=<>~!]")
PASTED = re.compile(r": |\n|^(?!.*\.\w{1,5}$)\S+(?: \S+){2,}")
"""Match a pasted error, not the name of a file: a colon, several lines, or three words without a suffix."""

HELP = (
    "Explain a failure: its cause, the fix, a reference, and the command to type next. Give a log file, a pasted"
    " error, `-` to read standard input, or a command after `--`. The command runs as usual; if it fails, the"
    " explanation follows its output."
)


class UsageError(Exception):
    """Raised for arguments or files that cannot be used; the message says what to do."""


class Knowledge(NamedTuple):
    """Reference data for failures, read only when there is one: known failures and measured results."""

    signatures: Callable[[], Sequence[Signature]]
    measured: Callable[[], Optional[Mapping[str, Any]]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `explain` to a parser."""
    parser.usage = (
        "%(prog)s [--python PATH] [--json] [FILE | TEXT | -]\n       %(prog)s [--python PATH] [--json] -- COMMAND..."
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        nargs="?",
        help="a log, a traceback or the output of a notebook cell; or the pasted error itself; `-`: standard input",
    )
    parser.add_argument("--python", metavar="PATH", help="the interpreter or environment in which it failed")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def split(arguments: Sequence[str]) -> Tuple[List[str], Optional[List[str]]]:
    """Split the arguments into our own and the command after `--`; the command is None without `--`."""
    if "--" not in arguments:
        return list(arguments), None
    place = list(arguments).index("--")
    return list(arguments[:place]), list(arguments[place + 1 :])


def of_text(args: argparse.Namespace, knowledge: Knowledge, place: Place) -> int:
    """Explain a file or stdin. Raises Bad."""
    excerpt = _read(args.file)
    if not excerpt.text.strip():
        source = "stdin" if args.file in {None, "-"} else args.file
        message = "explain: {} is empty; give the complete output of the failed command".format(source)
        raise UsageError(message)
    around = _find_packages(args.python, ()) if args.python else None
    here = _gather_facts(around, knowledge)
    explanation = _with_missing(explain_text(excerpt.text, knowledge.signatures(), here), excerpt)
    if args.json:
        print(json.dumps(explanation.plain()))
    else:
        _print(explanation, _complete_place(place, around, ()), sys.stdout)
    return 0 if explanation.cause is not None else UNKNOWN


def of_command(args: argparse.Namespace, command: Sequence[str], knowledge: Knowledge, place: Place) -> int:
    """Run a command, and explain it where it fails; its output goes to `place.output_file`. Raises Bad."""
    from . import run_command  # noqa: PLC0415 - Windows lacks what it needs

    if not command:
        message = "explain: there is no command after --"
        raise UsageError(message)
    if os.name == "nt":
        message = "explain: cannot run a command on Windows; redirect its output into a file (2>&1), and give that"
        raise UsageError(message)
    if args.file is not None:
        message = "explain: a FILE or a command, not both: {} stands before --".format(args.file)
        raise UsageError(message)
    # This comes before the command runs, so that a wrong --python is refused while nothing has happened.
    around = _find_packages(args.python, command)
    path = place.output_file or _temporary()
    with open(path, "wb") as log:
        ended = run_command.run(command, log, apart=args.json)
    if ended.code == 0:
        os.unlink(path)
        return _report_nothing(args, ended.code, None)
    if ended.trouble:
        os.unlink(path)
        return _report_nothing(args, ended.code, ended.trouble)
    if ended.code == INTERRUPTED:
        # This is the code of Ctrl-C: the user ended the command, and there is no failure to explain.
        return _report_nothing(args, ended.code, "interrupted; its output is in {}".format(path))
    with open(path, "rb") as written:
        excerpt = log_excerpt.read_excerpt(written.read)
    requirements = _find_requirements(command)
    here = _gather_facts(around, knowledge)._replace(failed=True, signal=ended.signal, requirements=requirements)
    explanation = _with_end(
        _with_missing(explain_text(excerpt.text, knowledge.signatures(), here), excerpt), ended.code
    )
    if args.json:
        print(json.dumps(explanation.plain()))
    place = _complete_place(place, around, requirements)._replace(command=tuple(command), output_file=path)
    end = "killed by {}".format(ended.signal) if ended.signal else "exit code {}".format(ended.code)
    _print(explanation, place, sys.stderr, "\nexplain: {} failed: {}".format(os.path.basename(command[0]), end))
    return ended.code


def _report_nothing(args: argparse.Namespace, code: int, why: Optional[str]) -> int:
    """Report why there is nothing to explain, and return the command's exit code."""
    if why:
        print("explain: {}".format(why), file=sys.stderr)
    if args.json:
        print(json.dumps({"schema": 1, "decisive": why, "phase": None, "diagnoses": [], "findings": []}))
    return code


def _complete_place(place: Place, around: Optional[Packages], requirements: Tuple[str, ...]) -> Place:
    """Return the place with the environment and the requirements of the same combination.

    These are the requirements asked for, else the installed packages that matter.
    """
    if around is None:
        return place._replace(requirements=requirements)
    # No packages at all count as not known, and the installer is then pip: nothing says that it is missing.
    return place._replace(
        python=around.python,
        version=around.version,
        requirements=requirements or tuple(explanation_text.subjects(around.installed)),
        installer=installer(around.python, around.installed or None),
    )


def _find_requirements(command: Sequence[str]) -> Tuple[str, ...]:
    """Return the requirements with versions that an installer's command line names."""
    if "install" not in command and "compile" not in command:
        return ()
    return tuple(word for word in command if PINNED.match(word) and _is_requirement(word))


def _is_requirement(word: str) -> bool:
    try:
        return bool(requirement(word).specifiers)
    except ValueError:
        return False


def _print(explanation: Explanation, place: Place, stream: TextIO, *before: str) -> None:
    lines = wrapping.wrap_lines(explanation_text.lines(explanation, place), wrapping.width(stream))
    text = "\n".join([*before, *lines])
    wrapping.print_text(text, stream)


def _with_missing(explanation: Explanation, excerpt: Excerpt) -> Explanation:
    if not excerpt.missing:
        return explanation
    text = "{:.1f} of {:.1f} MB were skipped: the beginning, the end and each traceback were read".format(
        excerpt.missing / 1e6, excerpt.size / 1e6
    )
    return explanation._replace(findings=(*explanation.findings, ("left out", "note", text)))


def _with_end(explanation: Explanation, code: int) -> Explanation:
    """Use the command's exit code as decisive line if its output has none."""
    if explanation.failure.decisive:
        return explanation
    line = "exited with code {} without a word".format(code) if code < 128 else "killed without a word"
    return explanation._replace(failure=explanation.failure._replace(decisive=line))


# --- what is read ----------------------------------------------------------------------------------------------


def _read(file: Optional[str]) -> Excerpt:
    if file is None and sys.stdin is not None and sys.stdin.isatty():
        message = "explain: give a FILE, a text on stdin, or a command after --"
        raise UsageError(message)
    if file in {None, "-"}:
        return log_excerpt.read_excerpt(sys.stdin.buffer.read if sys.stdin else io.BytesIO().read)
    if PASTED.search(str(file)) and not os.path.exists(str(file)):
        return log_excerpt.read_excerpt(io.BytesIO(str(file).encode("utf-8", "replace")).read)
    try:
        with open_file(str(file)) as stream:
            return log_excerpt.read_excerpt(stream.read)
    except OSError as error:
        message = "explain: {}: cannot be read: {}".format(file, error.strerror)
        raise UsageError(message) from None


def _find_packages(python: Optional[str], command: Sequence[str]) -> Optional[Packages]:
    """Return the packages of the interpreter that `python` names, or that the command runs. Raises Bad."""
    folder = os.getcwd()
    if python is None:
        return packages.of_command(command, os.environ, folder)
    environment = packages.of_interpreter(python, os.environ, folder)
    if environment is None:
        message = "explain --python {}: there is no Python; name an interpreter or the folder of an environment".format(
            python
        )
        raise UsageError(message)
    return environment


def _gather_facts(around: Optional[Packages], knowledge: Knowledge) -> Facts:
    installed, python = (around.installed, around.version) if around and around.installed else (None, None)
    measured = knowledge.measured()
    return Facts(installed=installed, python=python, measured=measured, history=load_shipped)


def _temporary() -> str:
    descriptor, path = tempfile.mkstemp(prefix="simmatrix-explain-", suffix=".log")
    os.close(descriptor)
    return path

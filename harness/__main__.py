"""The command line: parse, dispatch to one module per verb, turn errors into messages and exit codes."""

from __future__ import annotations

import os
import sys

from harness.machine import interrupts

# Before all other imports: a signal ends the command with a sentence from its first line on. An installed command
# imports this module, so its name is asked; whoever else imports it keeps the signal handlers that it has.
if __name__ == "__main__" or os.path.basename(sys.argv[0]) in {"simmatrix", "harness"}:  # noqa: PTH119 - at once
    interrupts.at_once()

import argparse
import atexit
import errno
import gc
import importlib
import threading
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

import harness
from harness.model.errors import BadInput, CouldNotTell, HarnessError, in_the_way
from harness.standalone import output

GROUPS = {
    "find out": {
        "explain": ("harness.commands.explain", "explain a failure: its cause and its fix, from a log or a command"),
        "known": ("harness.commands.known", "list measured packages and known issues, or show one"),
        "recommend": ("harness.commands.recommend", "recommend versions that were measured together and work"),
        "check": ("harness.commands.check", "check requirement files or an environment against measured results"),
        "upgrade": ("harness.commands.upgrade", "predict what an upgrade changes: install, run, behaviour, pictures"),
        "try": ("harness.commands.try_", "measure one combination of requirements"),
        "doctor": ("harness.commands.doctor", "inspect an environment, and name the closest versions that work"),
        "repair": ("harness.commands.repair", "find the smallest change that makes a combination work"),
        "bisect": ("harness.commands.bisect", "find the release, day or Python at which a combination broke"),
        "compare": ("harness.commands.compare", "compare how two combinations behave"),
        "show": ("harness.commands.show", "show everything known about one combination"),
    },
    "measure": {
        "init": ("harness.commands.init", "write a matrix, a nox session and a workflow for your project"),
        "plan": ("harness.commands.plan", "list the combinations of a matrix, and those left out"),
        "lock": ("harness.commands.lock", "resolve every combination to hash-pinned requirements"),
        "run": ("harness.commands.run", "lock, build, install, test and report every combination of a matrix"),
        "freeze": ("harness.commands.freeze", "write how an environment behaves, or check that it still does"),
        "fetch": ("harness.commands.fetch", "download all that a matrix needs, to measure it without network"),
    },
    "publish": {
        "report": ("harness.commands.report", "print or write the tables of stored results"),
        "merge": ("harness.commands.merge", "merge the reports of shards and machines into one"),
        "site": ("harness.commands.site", "build a static site from reports"),
        "accept": ("harness.commands.accept", "write an expectation for each combination that fails now"),
        "ci": ("harness.commands.ci", "write a workflow that runs a matrix: GitHub, GitLab, Slurm"),
    },
    "keep house": {
        "gc": ("harness.commands.gc", "delete old results and unused cache entries"),
        "schema": ("harness.commands.schema_", "print the JSON Schema of matrix files and of every document"),
    },
}
"""Verbs by what a user wants, each with its module and one line of help. A module is imported when its verb is used."""

VERBS = {verb: entry for verbs in GROUPS.values() for verb, entry in verbs.items()}

NO_NAME = frozenset({errno.ENAMETOOLONG, errno.ELOOP})
"""Errors of the system for a path that no file can have: the path came from the command line, a variable or a file."""

LONGEST_PATH = 80
"""Characters of a path that a message shows, where it is too long for a file."""

GARBAGE = 50_000
"""Objects made before Python looks for circles among them: records are many and hold none."""


def console() -> None:
    """Run the command line of an installed command, and exit."""
    output.guard()
    code = main(sys.argv[1:])
    if threading.active_count() == 1:
        _leave(code)
    sys.exit(code)


def _leave(code: int) -> None:
    """Exit with a code, without the time that Python takes to free every object first."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:  # Python says what is to be said about that
        return
    atexit._run_exitfuncs()
    os._exit(code)


def main(arguments: Sequence[str]) -> int:
    """Run one verb and return the exit code of the contract."""
    gc.set_threshold(GARBAGE)
    try:
        verb, rest = _verb(arguments)
        module = _imported(VERBS[verb][0])
        parser = verb_parser(verb, module)
        parsed = _parsed(module, parser, rest)
        _stand_somewhere()
        interrupts.orderly()  # not while modules are imported: some crash where a signal raises in them
        code = int(module.main(parsed))
        print(end="", flush=True)  # what cannot be written any more is known here, not when Python ends
        return code
    except HarnessError as error:
        from harness.commands import verb_help  # noqa: PLC0415 - start-up

        verb_help.print_error(f"simmatrix: {error}")
        return error.exit_code
    except KeyboardInterrupt:
        print(interrupts.sentence(interrupts.INTERRUPTED), file=sys.stderr)
        return interrupts.INTERRUPTED
    except interrupts.Terminated:
        print(interrupts.sentence(interrupts.TERMINATED), file=sys.stderr)
        return interrupts.TERMINATED
    except Exception as error:
        return _unforeseen(error)


def verb_parser(verb: str, module: Any) -> argparse.ArgumentParser:
    """Return the parser of a verb with the options that its module declares."""
    parser = _VerbParser(verb, module.HELP)
    module.add_arguments(parser)
    return parser


class _VerbParser(argparse.ArgumentParser):
    """Parses the arguments of a verb. Exit codes and examples are read only when its help is shown."""

    def __init__(self, verb: str, text: str) -> None:
        super().__init__(
            prog=f"simmatrix {verb}", description=text, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        self.verb, self.text = verb, text

    def format_help(self) -> str:
        """Return the help, wrapped for the terminal. Commands to copy stay on one line."""
        import shutil  # noqa: PLC0415 - start-up

        from harness.commands import verb_help  # noqa: PLC0415 - start-up

        width = shutil.get_terminal_size().columns - 2
        self.description = verb_help.wrap(self.text, width)
        self.epilog = verb_help.epilog(self.verb, width)
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Print the usage, where every option is explained, and last what is wrong; exit with 2."""
        self.print_usage(sys.stderr)
        print(f"`{self.prog} --help` explains every option, with examples.", file=sys.stderr)
        self.exit(BadInput.exit_code, f"{self.prog}: error: {message}\n")


def _stand_somewhere() -> None:
    """Refuse to work in a folder that was removed. Raises BadInput."""
    try:
        os.getcwd()  # noqa: PTH109 - start-up
    except FileNotFoundError:
        message = "the working folder does not exist any more; change to another one"
        raise BadInput(message) from None


def _parsed(module: Any, parser: argparse.ArgumentParser, rest: Sequence[str]) -> argparse.Namespace:
    """Parse the arguments of a verb. If it takes a command after `--`, `after` holds that command as it is."""
    if not hasattr(module, "split"):
        return parser.parse_args(rest)
    # A command is split off before argparse sees it: it may have options that look like ours, and a second `--`.
    ours, command = module.split(rest)
    return parser.parse_args(ours, argparse.Namespace(after=command))


def _unforeseen(error: Exception) -> int:
    """Print an unforeseen error and return its exit code.

    An impossible file name and a shortage of this machine are no bugs, and are reported as such.
    """
    if isinstance(error, OSError) and error.errno in NO_NAME:
        print(f"simmatrix: {_shortened(str(error.filename))}: {error.strerror}; name another path", file=sys.stderr)
        return BadInput.exit_code
    machine = in_the_way(error)
    if machine:
        print(f"simmatrix: {machine}; fix that and run the same command again", file=sys.stderr)
        return CouldNotTell.exit_code
    import traceback  # noqa: PLC0415 - start-up

    traceback.print_exception(error)
    print("simmatrix: this is a bug of simmatrix, not of the packages; please report it", file=sys.stderr)
    return HarnessError.exit_code


def _shortened(path: str) -> str:
    return path if len(path) <= LONGEST_PATH else f"{path[:LONGEST_PATH]}..."


def _imported(name: str) -> Any:
    """Import a module. Its objects live to the end, so the garbage collector never looks at them."""
    if name in sys.modules:
        return sys.modules[name]
    gc.disable()
    try:
        return importlib.import_module(name)
    finally:
        gc.enable()
        gc.freeze()


def _verb(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Split the verb from its arguments; without any, print the list of verbs and exit."""
    parser = argparse.ArgumentParser(
        prog="simmatrix",
        description=harness.__doc__,
        epilog="\n".join(_help_of_verbs()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="simmatrix VERB [...]",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    parser.add_argument("verb", metavar="VERB", help=argparse.SUPPRESS)
    if not arguments:
        parser.print_help()
        parser.exit()
    # Only the first word is parsed here: what follows, `--help` too, belongs to the verb.
    verb = str(parser.parse_args(arguments[:1]).verb)
    if verb not in VERBS:
        from difflib import get_close_matches  # noqa: PLC0415 - start-up

        near = get_close_matches(verb, VERBS, n=1)
        parser.error(f'there is no verb "{verb}"' + (f'; did you mean "{near[0]}"?' if near else ""))
    return verb, arguments[1:]


def _help_of_verbs() -> Iterator[str]:
    width = max(map(len, VERBS))
    for purpose, verbs in GROUPS.items():
        yield f"{purpose}:"
        yield from (f"  {verb:<{width}}  {text}" for verb, (_, text) in verbs.items())
        yield ""
    yield "`simmatrix VERB --help` explains the options of a verb, with examples."


class _Version(argparse.Action):
    """Print the version of the distribution and exit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version  # noqa: PLC0415 - start-up

        print(f"simmatrix {version('simmatrix')}")
        parser.exit()


if __name__ == "__main__":
    console()

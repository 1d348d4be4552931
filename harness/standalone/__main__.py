"""Run `explain` or `doctor` where the harness is not installed: `python simmatrix-doctor.pyz explain|doctor ...`."""

from __future__ import annotations

import argparse
import gzip
import json
import os
import sys
from typing import Any, Dict, List, Mapping, Optional, Sequence

from . import output, running, wrapping
from .adapters import carried_file
from .doctor import doctor
from .doctor.environment_choice import NoEnvironment, find_own_python
from .explain import explain
from .explain.explanation_text import Place
from .failures import literals, remedies
from .failures.matching import Signature, read

SIGNATURES, LITERALS, MEASURED = "signatures.json", "literals.json", "measured.json.gz"
"""What the file carries beside the code."""

INTERRUPTED = 130
PROVE = "pip install simmatrix; simmatrix doctor --prove --python PATH"


def console() -> None:
    """Entry point of a process."""
    output.guard()
    sys.exit(main(sys.argv[1:]))


def main(arguments: Sequence[str]) -> int:
    """Run one verb and return its exit code."""
    ours, command = explain.split(arguments)
    parser = argparse.ArgumentParser(
        prog=_program(), description="Explain failures and inspect environments. Nothing is installed."
    )
    verbs = parser.add_subparsers(dest="verb", metavar="explain|doctor")
    explain.add_arguments(verbs.add_parser("explain", help="explain a failure", description=explain.HELP))
    _add_doctor(verbs.add_parser("doctor", help="inspect an environment"))
    args = parser.parse_args(ours)
    if args.verb is None:
        parser.error("name a verb: explain or doctor")
    if command is not None and args.verb == "doctor":
        parser.error("doctor takes no command after --")
    try:
        return _explain(args, command) if args.verb == "explain" else _doctor(args)
    except (explain.UsageError, NoEnvironment) as error:
        print("{}: {}".format(_program(), error), file=sys.stderr)
        return explain.BAD
    except KeyboardInterrupt:
        return INTERRUPTED


def _program() -> str:
    """Return our own command line as it can be typed again."""
    name = os.path.basename(sys.argv[0] or "simmatrix-doctor.pyz")
    return "python {}".format(name) if name.endswith(".pyz") else "python -m harness.standalone"


def _explain(args: argparse.Namespace, command: Optional[List[str]]) -> int:
    place = Place(program=_program(), alone=True)
    knowledge = explain.Knowledge(signatures=_load_signatures, measured=_load_measurements)
    if command is None:
        return explain.of_text(args, knowledge, place)
    return explain.of_command(args, command, knowledge, place)


def _add_doctor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--python", metavar="PATH", help="an interpreter, or the folder of an environment")
    parser.add_argument(
        "--env", metavar="ID", help="an environment to run, such as Ant-v5, for the closest working versions"
    )
    parser.add_argument("--rendering", action="store_true", help="also check which library renders, and its settings")
    parser.add_argument("--prove", action="store_true", help="needs simmatrix: prints the command that installs it")
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


def _doctor(args: argparse.Namespace) -> int:
    if args.prove:
        message = "doctor --prove needs simmatrix on Python 3.11 or newer: {}".format(PROVE)
        raise explain.UsageError(message)
    # Whoever types `/env/bin/python FILE doctor` means /env, even while another environment is active.
    request = doctor.Request(
        args.python,
        args.env,
        dict(os.environ),
        os.getcwd(),
        args.rendering,
        running=find_own_python(),
    )
    document = doctor.document(
        request, running.run, doctor.Knowledge(_load_signatures(), lambda: _load_measurements() or {})
    )
    lines = wrapping.wrap_lines(doctor.lines(document, remedies.in_words), wrapping.width(sys.stdout))
    wrapping.print_text(json.dumps(document) if args.json else "\n".join(lines), sys.stdout)
    return doctor.code(document)


# --- what the single file carries (a checkout has none of it) ---------------------------------------------------


def _load_signatures() -> List[Signature]:
    content = carried_file(SIGNATURES)
    if content is None:
        message = "this file has no list of known failures; write it with `simmatrix doctor --standalone FILE`"
        raise explain.UsageError(message)
    literals.remember(json.loads((carried_file(LITERALS) or b"{}").decode()))
    return [read(plain) for plain in json.loads(content.decode())]


def _load_measurements() -> Optional[Mapping[str, Any]]:
    content = carried_file(MEASURED)
    if content is None:
        return None
    measurements: Dict[str, Any] = json.loads(gzip.decompress(content).decode())
    return measurements


if __name__ == "__main__":
    console()

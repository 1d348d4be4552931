"""`simmatrix doctor`: inspect an existing environment, and name the nearest combination that is known to work."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from harness.commands import explain
from harness.model import decoding
from harness.model.errors import BadInput
from harness.model.report_types import DiagnosisEntry, FindingEntry
from harness.reports import doctor_pyz
from harness.reports.answers import result_index
from harness.rootcause.doctor import doctor_rendering, in_place, prove_in_copy
from harness.rootcause.doctor.doctor_rendering import Rendering
from harness.rootcause.doctor.in_place import Tried
from harness.rootcause.doctor.prove_in_copy import Proof
from harness.standalone import wrapping
from harness.standalone.doctor import doctor
from harness.standalone.doctor.environment_choice import NoEnvironment
from harness.standalone.failures.remedies import in_words
from harness.standalone.output import print_json

HELP = (
    "Inspect an environment without changing it: conflicting versions, shadowed or duplicate modules, effects of"
    " environment variables, and the closest combination that works. Without --python, this is the active environment,"
    " else ./.venv, else the Python on PATH."
)


class ChangeEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A change to another version of a package; `now` is None if the package is not installed."""

    name: str
    now: str | None
    then: str


class Nearest(msgspec.Struct, frozen=True, kw_only=True):
    """The nearest combination that was measured to work: `changes` lead to it, `also` are other, minor differences.

    `env` is the requested environment, if it was made and stepped there. `uncovered` are packages that are installed
    here but not in that combination.
    """

    cell: str
    env: str | None = None
    python: str
    machine: str
    measured: str
    lock: str
    distance: int
    changes: tuple[ChangeEntry, ...]
    also: tuple[ChangeEntry, ...]
    command: str | None
    uncovered: tuple[str, ...] = ()
    remarks: tuple[str, ...]


class DifferenceEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A difference that the caller's settings make; `by` are the settings that cause it, as far as known."""

    kind: str
    module: str
    as_it_is: str
    scrubbed: str
    by: tuple[str, ...]


class Imported(msgspec.Struct, frozen=True, kw_only=True):
    """The result of importing a module: its file and version, or the error."""

    error: str | None
    file: str | None
    version: str | None


class Environment(msgspec.Struct, frozen=True, kw_only=True):
    """The inspected environment, and why this one; `scrubbed` are the variables left out of the second inspection."""

    python: str
    why: str
    remarks: tuple[str, ...]
    version: str | None
    implementation: str | None = None
    prefix: str | None = None
    base_prefix: str | None = None
    executable: str | None = None
    conda: bool = False
    platform: str | None = None
    libc: str | None = None
    packages: dict[str, str] = {}
    scrubbed: tuple[str, ...] = ()


class Doctored(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `doctor --json`: `decisive` is the first warning, None where there is none.

    `diagnoses` are known failures that were seen, `lurking` those that these versions have.
    """

    schema: int = 1
    decisive: str | None
    diagnoses: tuple[DiagnosisEntry, ...]
    findings: tuple[FindingEntry, ...]
    environment: Environment
    imports: dict[str, Imported]
    differences: tuple[DifferenceEntry, ...]
    lurking: tuple[DiagnosisEntry, ...]
    nearest: Nearest | None
    tried: Tried | None = None
    proof: Proof | None = None
    rendering: Rendering | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `doctor`."""
    parser.add_argument("--python", metavar="PATH", help="an interpreter, or the folder of an environment")
    parser.add_argument("--env", metavar="ID", help="also make and step this environment in it")
    parser.add_argument("--api", metavar="A", help="API of --env: gym or gymnasium, if both are installed")
    parser.add_argument(
        "--rendering", action="store_true", help="also check which library renders, and on which device"
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help="measure the closest working versions in a temporary copy of the environment",
    )
    parser.add_argument("--offline", action="store_true", help="with --prove: use the caches only, never the network")
    parser.add_argument(
        "--standalone",
        type=Path,
        metavar="FILE",
        help="write explain and doctor as one file that runs on any Python from 3.7 on",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


def main(args: argparse.Namespace) -> int:
    """Inspect the environment, print the findings, and return the exit code."""
    if args.standalone:
        doctor_pyz.write(args.standalone)
        print(f"{args.standalone}: run it with `python {args.standalone} doctor` on machines without simmatrix")
        return 0
    knowledge = doctor.Knowledge(explain.signatures(), result_index.load_plain)
    request = doctor.Request(args.python, args.env, dict(os.environ), str(Path.cwd()), api=args.api)
    looks = in_place.HostInspection(env=args.env, api=args.api, rendering=args.rendering)
    try:
        plain = doctor.document(request, in_place.run, knowledge, looks.inspect)
    except NoEnvironment as error:
        message = f"doctor: {error}"
        raise BadInput(message) from None
    if args.prove:
        plain["proof"] = prove_in_copy.proof(plain, env=args.env, offline=args.offline)
    document = decoding.convert({**plain, "tried": looks.tried}, Doctored)
    if looks.drawn:
        document = msgspec.structs.replace(
            document, rendering=looks.drawn.rendering, diagnoses=(*document.diagnoses, *looks.drawn.diagnoses)
        )
    if args.json:
        print_json(msgspec.json.encode(document))
    else:
        print("\n".join(wrapping.wrap_lines(_lines(plain, document), wrapping.width(sys.stdout))))
    return doctor.code(plain)


def _lines(plain: Mapping[str, Any], document: Doctored) -> list[str]:
    lines = list(doctor.lines(plain, in_words))
    if document.tried and document.tried.decisive is None:
        lines += ["", document.tried.said]
    if document.proof:
        lines += ["", *prove_in_copy.lines(document.proof)]
    if document.rendering:
        lines += ["", *doctor_rendering.lines(document.rendering)]
        lines += [f"known: {one.cause}" for one in document.diagnoses if one.phase is None]
    return lines

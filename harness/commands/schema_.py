"""`simmatrix schema [NAME]`: print the JSON Schemas of matrix files and of every document."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

from harness.machine.files import given_files
from harness.model import schema
from harness.model.errors import BadInput

HELP = "Print the JSON Schema of matrix files or of a document that the harness writes; without a name, list them."


def _matrix() -> type:
    from harness.matrix.matrix_types import MatrixTable  # noqa: PLC0415 - only the schema asked for is made

    return MatrixTable


def _expansion() -> type:
    from harness.matrix.matrix_types import Expansion  # noqa: PLC0415

    return Expansion


def _controls() -> type:
    from harness.running.controls import ControlsFile  # noqa: PLC0415

    return ControlsFile


def _report() -> type:
    from harness.model.report_types import Document  # noqa: PLC0415

    return Document


def _plan() -> type:
    from harness.commands.plan import Planned  # noqa: PLC0415

    return Planned


def _lock() -> type:
    from harness.commands.lock import Locked  # noqa: PLC0415

    return Locked


def _overlay() -> type:
    from harness.matrix.overlay_recipes import RecipeTable  # noqa: PLC0415

    return RecipeTable


def _signatures() -> type:
    from harness.matrix.signatures import SignaturesFile  # noqa: PLC0415

    return SignaturesFile


def _manifest() -> type:
    from harness.running.offline.offline_bundle import Manifest  # noqa: PLC0415

    return Manifest


def _init() -> type:
    from harness.commands.init import Started  # noqa: PLC0415

    return Started


def _collected() -> type:
    from harness.commands.gc import Collected  # noqa: PLC0415

    return Collected


def _bisected() -> type:
    from harness.rootcause.bisection.certificates import BisectDocument  # noqa: PLC0415

    return BisectDocument


def _doctored() -> type:
    from harness.commands.doctor import Doctored  # noqa: PLC0415

    return Doctored


def _recommended() -> type:
    from harness.reports.answers.recommended import Recommended  # noqa: PLC0415

    return Recommended


def _explained() -> type:
    from harness.commands.explain import Explained  # noqa: PLC0415

    return Explained


def _known_document() -> type:
    from harness.commands.known import KnownDocument  # noqa: PLC0415

    return KnownDocument


def _repair() -> type:
    from harness.rootcause.repair.proofs import RepairDocument  # noqa: PLC0415

    return RepairDocument


DOCUMENTS: dict[str, tuple[str, Callable[[], type]]] = {
    "matrix": ("a matrix file, `matrices/NAME.toml`", _matrix),
    "expansion": ("what the ranges and the strategy of a matrix came to, `NAME.expanded.json`", _expansion),
    "overlay": ("how a package is repaired, `overlays/PACKAGE.toml`", _overlay),
    "controls": ("known-good combinations of adapters, `controls/controls.toml`", _controls),
    "signatures": ("known failures, `signatures/FAMILY.toml`", _signatures),
    "report": ("`report.json`, and `--json` of run, try, report, show and merge", _report),
    "plan": ("`plan --json`", _plan),
    "lock": ("`lock --json`", _lock),
    "gc": ("`gc --json`", _collected),
    "init": ("`init --json`", _init),
    "bisect": ("`bisect.json`, and `--json` of bisect", _bisected),
    "doctor": ("`doctor --json`", _doctored),
    "explain": ("`explain --json`", _explained),
    "recommend": ("`recommend --json`", _recommended),
    "known": ("`known --json`", _known_document),
    "repair": ("`repair.json`, and `repair --json`", _repair),
    "manifest": ("`manifest.json` of `fetch`, and its `--json`", _manifest),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `schema`."""
    parser.add_argument("name", metavar="NAME", nargs="?", help=f"one of {', '.join(DOCUMENTS)}")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write it to a file instead of stdout")
    parser.add_argument("--json", action="store_true", help="without a name: all schemas as one JSON object")


def main(args: argparse.Namespace) -> int:
    """Print one schema, all of them, or their names."""
    if args.name is None and not args.json and not args.out:
        for name, (what, _) in DOCUMENTS.items():
            print(f"{name:<10} {what}")
        return 0
    text = json.dumps(_schemas(args.name), indent=2, ensure_ascii=False) + "\n"
    if args.out:
        given_files.write_text(args.out, text)
    else:
        print(text, end="")
    return 0


def _schemas(name: str | None) -> object:
    if name is None:
        return {known: _schema(known) for known in DOCUMENTS}
    if name not in DOCUMENTS:
        message = f"schema {name}: unknown document{schema.suggestion(name, DOCUMENTS)}"
        raise BadInput(message)
    return _schema(name)


def _schema(name: str) -> object:
    what, kind = DOCUMENTS[name]
    json_schema = schema.json_schema(kind())
    return {"$schema": json_schema.pop("$schema"), "title": f"simmatrix: {what}", **json_schema}

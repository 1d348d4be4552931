"""`simmatrix schema [NAME]`: print the JSON Schemas of matrix files and of every document."""

from __future__ import annotations

import argparse
import json
from importlib import import_module
from pathlib import Path

from harness.machine.files import given_files
from harness.model import schema
from harness.model.errors import BadInput

HELP = "Print the JSON Schema of matrix files, or of a document that simmatrix writes. Without a name, list them."

DOCUMENTS = {
    "matrix": ("a matrix file, `matrices/NAME.toml`", "matrix.matrix_types", "MatrixTable"),
    "expansion": (
        "what the ranges and the strategy of a matrix came to, `NAME.expanded.json`", "matrix.matrix_types", "Expansion"
    ),
    "overlay": ("how a package is repaired, `overlays/PACKAGE.toml`", "matrix.overlay_recipes", "RecipeTable"),
    "controls": ("known-good combinations of adapters, `controls/controls.toml`", "running.controls", "ControlsFile"),
    "signatures": ("known failures, `signatures/FAMILY.toml`", "matrix.signatures", "SignaturesFile"),
    "report": ("`report.json`, and `--json` of run, try, report, show and merge", "model.report_types", "Document"),
    "plan": ("`plan --json`", "commands.plan", "Planned"),
    "lock": ("`lock --json`", "commands.lock", "Locked"),
    "gc": ("`gc --json`", "commands.gc", "Collected"),
    "init": ("`init --json`", "commands.init", "Started"),
    "bisect": ("`bisect.json`, and `--json` of bisect", "rootcause.bisection.certificates", "BisectDocument"),
    "doctor": ("`doctor --json`", "commands.doctor", "Doctored"),
    "explain": ("`explain --json`", "reports.explanations.explained", "Explained"),
    "compare": ("`compare --json`", "commands.compare", "ComparedCells"),
    "freeze": ("`freeze --check --json`", "commands.freeze", "BehaviourCheck"),
    "recommend": ("`recommend --json`", "reports.answers.recommended", "Recommended"),
    "check": ("`check --json`", "reports.projects.check_document", "Checked"),
    "checks": ("`check --each --json`", "reports.projects.check_document", "CheckedFiles"),
    "upgrade": ("`upgrade --json`", "reports.projects.upgrade_document", "Upgraded"),
    "known": ("`known --json`", "commands.known", "KnownDocument"),
    "site": ("`site --json`", "commands.site", "SiteDocument"),
    "repair": ("`repair.json`, and `repair --json`", "rootcause.repair.proofs", "RepairDocument"),
    "manifest": ("`manifest.json` of `fetch`, and its `--json`", "running.offline.offline_bundle", "Manifest"),
}  # fmt: skip
"""Each document in words, and its type: the module, which is imported only when its schema is asked for, and the class.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `schema`."""
    parser.add_argument("name", metavar="NAME", nargs="?", help=f"one of: {', '.join(DOCUMENTS)} (default: list them)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the schema to this file (default: stdout)")
    parser.add_argument("--json", action="store_true", help="without a name: print all schemas as one JSON object")


def main(args: argparse.Namespace) -> int:
    """Print one schema, all of them, or their names."""
    if args.name is None and not args.json and not args.out:
        for name, (what, _, _) in DOCUMENTS.items():
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
    what, module, kind = DOCUMENTS[name]
    json_schema = schema.json_schema(getattr(import_module(f"harness.{module}"), kind))
    return {"$schema": json_schema.pop("$schema"), "title": f"simmatrix: {what}", **json_schema}

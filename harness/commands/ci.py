"""`simmatrix ci MATRIX --provider P`: write a workflow that runs a matrix on GitHub, GitLab, or a Slurm cluster."""

from __future__ import annotations

import argparse
import difflib
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import distribution, version
from pathlib import Path

from harness.ci import pipelines
from harness.ci.pipelines import Pipeline, Provider
from harness.commands import arguments, select_cells
from harness.commands.select_cells import select
from harness.machine.console import tell
from harness.machine.files import given_files
from harness.model import Plan
from harness.model.errors import BadInput
from harness.model.report_types import format_count
from harness.reports.template_files import read_template
from harness.reports.text import github_annotations
from harness.running import open_matrix

HELP = (
    "Write a workflow that measures a matrix on GitHub, on GitLab or on a Slurm cluster. It plans, measures in balanced"
    " shards, and merges the reports; the merge decides between success and failure."
)

FAIL_ON = ("unexpected", "stale", "not_run")
"""A shard that was lost leaves gaps, which must not be green."""

DIFFERENCES = 20
"""Lines of a difference that are shown."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ci`."""
    parser.add_argument(
        "matrix", metavar="MATRIX", help="a matrix file of this repository, or the name of a built-in matrix"
    )
    parser.add_argument("--provider", choices=[one.value for one in Provider], default="github", metavar="PROVIDER",
                        help="github, gitlab or slurm (default: github)")  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the workflow to this file (default: stdout)")
    parser.add_argument(
        "--check", type=Path, metavar="FILE", help="compare with this file; exit status 1 if it is out of date"
    )
    parser.add_argument(
        "--shards", type=_count, metavar="N", help="number of jobs (default: as many as --minutes asks for)"
    )
    parser.add_argument("--minutes", type=_count, default=15, metavar="M", help="minutes of work per job (default: 15)")
    arguments.durations(parser)
    parser.add_argument("--limit", type=_count, default=90, metavar="M", help="end a job after M minutes (default: 90)")
    parser.add_argument(
        "--install", metavar="WORDS", help="what pip installs in the workflow (default: this version of simmatrix)"
    )
    parser.add_argument("--python", default="3.11", metavar="V", help="the Python that runs simmatrix (default: 3.11)")
    parser.add_argument(
        "--branch", default="main", metavar="NAME", help="GitHub: pushes to this branch are measured (default: main)"
    )
    parser.add_argument(
        "--runner", metavar="NAME", help="GitHub: the runner (default: ubuntu-24.04); GitLab: the image"
    )
    arguments.fail_on(parser, FAIL_ON)
    parser.add_argument("--emit", choices=EMITTED, default=EMITTED[0], metavar="PART",
                        help="print workflow, summary or shards; for use in workflows (default: workflow)")  # fmt: skip


EMITTED = ("workflow", "summary", "shards")
MEASURING = ("durations",)
PLANNING = ("shards", "minutes", *MEASURING)
OPTIONS = (*PLANNING, "limit", "install", "python", "branch", "runner", "fail_on")
"""What a workflow depends on beside its matrix, in the order in which its first line tells it."""


def main(args: argparse.Namespace) -> int:
    """Print, write or compare the workflow."""
    if args.check and args.out:
        message = "--check compares and --out writes: name one of them"
        raise BadInput(message)
    # Offline, since each job plans the matrix by itself: the index could give them different plans.
    plan = open_matrix.load(args.matrix, tell, offline=True)
    select(plan.cells, None)
    count = _shards(args, plan)
    match args.emit:
        case "summary":
            text = github_annotations.summary(pipelines.plan_page(plan, count))
        case "shards":
            text = pipelines.shard_outputs(count)
        case _:
            text = workflow(args, plan, count)
    if args.check:
        return _check(args.check, text)
    if args.out:
        given_files.write_text(args.out, text)
        tell(f"workflow: {args.out}")
    else:
        sys.stdout.write(text)
    return 0


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        message = f"{text!r} is not a whole number of at least 1"
        raise argparse.ArgumentTypeError(message)
    return int(text)


def _shards(args: argparse.Namespace, plan: Plan) -> int:
    """Return the number of shards: `--shards`, else by the work. Raises BadInput above the limit of the platform."""
    most = pipelines.MOST_SHARDS[args.provider]
    if args.shards and args.shards > most:
        message = f"--shards {args.shards}: {args.provider} runs at most {most} jobs of one kind"
        raise BadInput(message)
    if args.shards:
        return int(args.shards)
    committed = select_cells.committed_report(open_matrix.locate(args.matrix), plan.matrix)
    seconds = select_cells.durations([*([committed] if committed else []), *args.durations])
    return pipelines.shard_count([cell.id for cell in plan.cells], seconds, args.minutes, most)


# --- the workflow ----------------------------------------------------------------------------------------------


def workflow(args: argparse.Namespace, plan: Plan, count: int) -> str:
    """Return the text of the workflow file: the same bytes for the same matrix, options and version."""
    provider = Provider(args.provider)
    for option in _given(args, pipelines.FOREIGN[provider]):
        message = f"{option}: has no effect on {provider}; leave it out"
        raise BadInput(message)
    path = _in_repository(args.matrix) if args.matrix.endswith(".toml") else None
    matrix = pipelines.plain(path or args.matrix, "MATRIX")
    pipeline = Pipeline(
        matrix=matrix,
        name=pipelines.plain(plan.matrix, "the name of the matrix"),
        made_by=shlex.join(["simmatrix", "ci", matrix, "--provider", provider, *_given(args, OPTIONS)]),
        shards=count,
        planning=shlex.join(["--provider", provider, *_given(args, PLANNING)]),
        measuring=shlex.join(["-j", "auto", *_given(args, MEASURING)]),
        state=_state(path),
        dated=all(cell.question.snapshot for cell in plan.cells),
        install=pipelines.words(args.install or _this_version(quiet=args.check is not None), "--install"),
        python=pipelines.python(args.python),
        branch=pipelines.plain(args.branch, "--branch"),
        runner=pipelines.plain(args.runner or pipelines.RUNNERS[provider].format(python=args.python), "--runner"),
        limit=args.limit,
        fail_on=",".join(args.fail_on),
    )
    actions = pipelines.actions(read_template(pipelines.ACTIONS))
    return pipelines.render(pipeline, read_template(pipelines.TEMPLATES[provider]), actions)


def installable() -> str | None:
    """Return the pip arguments that install this simmatrix, None if only this machine has it."""
    return pipelines.install_words(distribution("simmatrix").read_text("direct_url.json"), version("simmatrix"))


def _this_version(*, quiet: bool) -> str:
    """Return the pip arguments for this simmatrix. If only this machine has it, guess the release and print a note."""
    requirement = installable()
    if requirement is None and not quiet:
        tell(
            f"note: the workflow installs simmatrix=={version('simmatrix')}, but this copy was not installed from a "
            "package index, which may not have it. Name a source that the workflow can reach: "
            "--install git+ADDRESS@COMMIT, or --install ./FOLDER/simmatrix.whl for a wheel in this repository"
        )
    return requirement or f"simmatrix=={version('simmatrix')}"


def _state(path: str | None) -> str:
    """Return the cache key of the matrix: the version of simmatrix for a built-in one, else a hash of its files."""
    if path is None:
        return version("simmatrix")
    # `pipelines.plain` has accepted this path before, so no quote in it can end the expression.
    return f"${{{{ hashFiles('{path}', '{path.removesuffix('.toml')}.expanded.json') }}}}"


def _given(args: argparse.Namespace, names: Sequence[str]) -> Iterator[str]:
    """Yield the options that differ from their defaults, as they are typed."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    for name in names:
        value, option = getattr(args, name), f"--{name.replace('_', '-')}"
        if isinstance(value, list):
            yield from (word for file in value for word in (option, _in_repository(str(file))))
        elif value != parser.get_default(name):
            yield from (option, ",".join(value) if isinstance(value, tuple) else str(value))


def _in_repository(name: str) -> str:
    """Return the path of a file from the root of its repository. Raises BadInput unless that is the working folder."""
    here = Path.cwd()
    root = next((folder for folder in (here, *here.parents) if (folder / ".git").exists()), here)
    if root != here:
        message = (
            f"{name}: workflows run at the root of the repository; run this command there, in {os.path.relpath(root)}"
        )
        raise BadInput(message)
    path = Path(os.path.relpath(name))
    if ".." in path.parts:
        message = f"{name}: lies outside the working folder, so no checkout has it; copy it into the repository"
        raise BadInput(message)
    return path.as_posix()


# --- comparing -------------------------------------------------------------------------------------------------


def _check(file: Path, text: str) -> int:
    """Compare a file with a text byte by byte. Return 0 if equal, else print the difference to stderr and return 1."""
    try:
        there = given_files.read_content(file, f"--check {file}")
    except BadInput as error:
        message = f"{error}; --out {file} makes it"
        raise BadInput(message) from None
    if there == text.encode():
        tell(f"{file}: is up to date")
        return 0
    before = there.decode("utf-8", "replace").splitlines()
    lines = list(
        difflib.unified_diff(before, text.splitlines(), f"{file}", "as it would be made now", n=1, lineterm="")
    )
    for line in lines[:DIFFERENCES]:
        tell(line)
    if len(lines) > DIFFERENCES:
        tell(f"... and {format_count(len(lines) - DIFFERENCES, 'more line')}")
    tell(f"{file}: is out of date; the command in its first lines, with --out {file}, makes it again")
    return 1

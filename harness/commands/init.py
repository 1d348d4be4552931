"""`simmatrix init [FOLDER]`: write a matrix, a nox session and a workflow for a project; nothing is overwritten."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from harness.ci import drafts, first_draft, workflows
from harness.ci.drafts import Draft, Project
from harness.ci.workflows import Fate, Job, Leg
from harness.commands import ci
from harness.machine import store
from harness.machine.console import tell
from harness.machine.files import given_files
from harness.model.errors import BadInput, CouldNotTell
from harness.model.report_types import format_count
from harness.model.vocabulary import Label
from harness.packages.requirement_files import project
from harness.reports.answers import misspelt
from harness.reports.template_files import read_template
from harness.running import open_matrix
from harness.standalone.output import print_json

HELP = (
    "Write a first matrix, a nox session and a GitHub workflow for a project. With --from, the matrix has the"
    " combinations that an existing workflow installs. Versions that the project allows, but the workflow never"
    " installs, are listed. Existing files are kept."
)

NOX_LINES = """\
import sys

import nox

try:
    from harness import noxface
except ImportError as missing:  # nox was installed apart
    print(f"simmatrix cannot be imported ({missing}): install it next to nox", file=sys.stderr)
else:
    noxface.cells(@NAMES@)
"""


class Started(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `init --json`; `jobs` are those of the workflow of --from.

    `not_found_out` lists open questions, such as ranges if the index was not asked.
    """

    schema: int = 1
    written: tuple[str, ...]
    kept: tuple[str, ...]
    jobs: tuple[Job, ...]
    not_found_out: tuple[str, ...] = ()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `init`."""
    parser.add_argument(
        "folder",
        metavar="FOLDER",
        nargs="?",
        type=Path,
        default=Path(),
        help="folder of the project (default: the working folder)",
    )
    parser.add_argument(
        "--from",
        dest="workflow",
        type=Path,
        metavar="WORKFLOW",
        help="an existing GitHub workflow, such as .github/workflows/ci.yml",
    )
    parser.add_argument("--name", metavar="NAME", help="name of the matrix (default: name of the project)")
    parser.add_argument(
        "--offline", action="store_true", help="never ask the package index; version ranges and environments stay open"
    )
    parser.add_argument(
        "--install", metavar="WORDS", help="what pip installs in the workflow (default: this simmatrix)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout, and nothing else")


@dataclass
class _Files:
    """The files of a first matrix: written ones, ones that were there, the cells of each matrix, and open questions."""

    say: Callable[[str], None]
    written: list[str] = field(default_factory=list)
    existing: list[str] = field(default_factory=list)
    cells: dict[Path, int] = field(default_factory=dict)
    open: list[str] = field(default_factory=list)

    def write(self, path: Path, text: str) -> bool:
        """Write a file unless there is one. Return whether it was written."""
        if path.exists():
            self.existing.append(path.as_posix())
            return False
        store.write_atomic(path, text.encode())
        self.say(f"wrote {path}")
        self.written.append(path.as_posix())
        return True


def main(args: argparse.Namespace) -> int:
    """Write the missing files, and keep existing ones. Return 0, or 3 if something could not be found out."""
    say = tell if args.json else print
    # Read before `chdir`: the path of --from starts in the user's folder.
    jobs = (
        workflows.read(given_files.read_text(args.workflow, f"--from {args.workflow}"), str(args.workflow))
        if args.workflow
        else ()
    )
    if not args.folder.is_dir():
        message = f"{args.folder}: is not a folder"
        raise BadInput(message)
    files = _Files(say)
    for line in _describe_jobs(jobs, args.workflow):
        say(line)
    with chdir(args.folder):
        about = _project()
        # Before anything is written: a dependency that no index has is a typo.
        misspelt.check(about.dependencies, tell, offline=args.offline)
        matrix_drafts = _drafts(about, jobs, args)
        matrices = [_path(name) for name in matrix_drafts]
        if all(path.exists() for path in matrices):
            for path in matrices:
                files.existing.append(path.as_posix())
                say(f"{path}: exists already and is kept")
        else:
            _matrices(about, matrix_drafts, args, files)
        _nox(matrices, files)
        for path in matrices:
            _planned(path, args, files)
            _workflow(path, args.install, files)
        _next(args, matrices, files)
    if args.json:
        document = Started(
            written=tuple(files.written), kept=tuple(files.existing), jobs=jobs, not_found_out=tuple(files.open)
        )
        # Numbers of a workflow keep their written form in a subclass of float, which msgspec does not encode by itself.
        print_json(msgspec.json.encode(document, enc_hook=float))
    return 3 if files.open else 0


def _next(args: argparse.Namespace, matrices: Sequence[Path], files: _Files) -> None:
    """Say what to type next, and what could not be found out."""
    for path, count in files.cells.items():
        files.say(f"next: simmatrix run {path}  ({format_count(count, 'cell')})")
        if path.with_suffix(".expanded.json").exists():
            files.say(f"later: simmatrix lock {path} --upgrade  (newer releases, for a scheduled workflow, too)")
    for line in files.open:
        files.say(f"still open: {line}")
    if files.open and files.written:
        again = "without --offline" if args.offline else "once that is fixed"
        files.say(f"next: run `simmatrix init` again {again}; it keeps existing files, so remove {matrices[0]} first")


def _matrices(about: Project, matrix_drafts: dict[str, Draft], args: argparse.Namespace, files: _Files) -> None:
    """Write the matrices that are not there, with the environments of the installed package as their cases."""
    pythons = next(iter(matrix_drafts.values())).pythons
    files.say("asking the installed package for its environments, and trying some of them")
    first_cases = first_draft.cases(about, pythons, offline=args.offline)
    if not first_cases.importable:
        files.open.append(first_cases.notes[0] if first_cases.notes else "the environments of the package")
    for line in first_cases.notes if first_cases.importable else ():
        files.say(f"  {line}")
    for name, draft in matrix_drafts.items():
        whole = first_draft.complete(draft, about, first_cases, offline=args.offline)
        path, template = _path(name), read_template("matrix.toml.j2")
        if not files.write(path, drafts.text_of(whole, template)):
            files.say(f"{path}: exists already and is kept")
            continue
        fitting = whole if args.offline else first_draft.without_clashes(whole, path)
        if fitting != whole:
            store.write_atomic(path, drafts.text_of(fitting, template).encode())
            # It was expanded from the ranges before; `_planned` expands the new ones.
            path.with_suffix(".expanded.json").unlink(missing_ok=True)


def _planned(path: Path, args: argparse.Namespace, files: _Files) -> None:
    """Expand the ranges of a matrix and count its cells. Note an open question if the index cannot be asked."""
    try:
        files.cells[path] = len(open_matrix.load(str(path), tell, offline=args.offline).cells)
    except CouldNotTell as error:
        files.open.append(str(error))


# --- the project -----------------------------------------------------------------------------------------------


def _path(name: str) -> Path:
    """Return the path of a matrix file, in a folder that does not break the project's build."""
    return (
        Path(drafts.matrix_folder(*_texts("pyproject.toml", "setup.py", "setup.cfg"), src=Path("src").is_dir()))
        / f"{name}.toml"
    )


def _texts(*names: str) -> list[str]:
    return [given_files.read_text(path) if path.is_file() else "" for path in map(Path, names)]


def _project() -> Project:
    texts = _texts(*project.FILES)
    if not any(texts):
        message = f"{Path.cwd()}: has neither pyproject.toml nor setup.py; name the folder of a project"
        raise BadInput(message)
    return drafts.read_project(texts[0], texts[1], Path.cwd().name)


def _drafts(about: Project, jobs: tuple[Job, ...], args: argparse.Namespace) -> dict[str, Draft]:
    """Return the matrices to be written, by their names."""
    name = _name(about, args.name)
    if not args.workflow:
        return {name: drafts.of_project(about)}
    job_drafts = {job.name: drafts.of_legs(job.legs, args.workflow.name) for job in jobs}
    readable_drafts = {job: draft for job, draft in job_drafts.items() if draft}
    if not readable_drafts:
        message = (
            f"{args.workflow}: none of its jobs can be read; `simmatrix init` without --from starts from the project"
        )
        raise BadInput(message)
    return {name if len(readable_drafts) == 1 else f"{name}-{job}": draft for job, draft in readable_drafts.items()}


def _name(about: Project, given: str | None) -> str:
    """Return the name of the matrix, also of its files and folders. Raises BadInput if it cannot be a label."""
    try:
        return str(Label.canonical(about.name if given is None else given))
    except ValueError as error:
        where, hint = ("the project", "; name the matrix with --name") if given is None else ("--name", "")
        message = f"{where}: {error}{hint}"
        raise BadInput(message) from None


# --- nox and CI ------------------------------------------------------------------------------------------------


def _nox(matrices: list[Path], files: _Files) -> None:
    names = ", ".join(f'"{path.as_posix()}"' for path in matrices)
    lines = NOX_LINES.replace("@NAMES@", names)
    about = f'"""`nox -t {matrices[0].stem}` measures the matrix, `nox -l` lists its cells."""\n\n'
    noxfile = Path("noxfile.py")
    if not files.write(noxfile, about + lines) and names not in noxfile.read_text(encoding="utf-8"):
        files.say(f"{noxfile}: exists already and is kept; add these lines to it:\n\n{lines}")


def _workflow(matrix: Path, install: str | None, files: _Files) -> None:
    """Write the workflow that `simmatrix ci` makes, under another name if there is one of another matrix."""
    folder = Path(".github/workflows")
    path = folder / "simmatrix.yml"
    # The first lines of a workflow hold the command that made it, and so tell its matrix.
    if path.exists() and f"ci {matrix} " not in path.read_text(encoding="utf-8", errors="replace"):
        path = folder / f"simmatrix-{matrix.stem}.yml"
    if path.exists():
        files.existing.append(path.as_posix())
        files.say(f"{path}: exists already and is kept; `simmatrix ci {matrix} --check {path}` compares")
        return
    install = install or ci.installable()
    # `ci` refuses a matrix whose ranges were never expanded with CouldNotTell, which would end `init` here.
    if matrix not in files.cells:
        return
    if install is None:
        files.say(
            f"no workflow: this simmatrix was not installed from an index, so a workflow cannot say how to install it; "
            f"`simmatrix ci {matrix} --out {path} --install git+ADDRESS@COMMIT` writes it"
        )
        return
    # The options go through the parser of `ci`, so that a later `ci --check` compares with the same defaults.
    parser = argparse.ArgumentParser()
    ci.add_arguments(parser)
    branch = ["--branch", "master"] if _head() == "ref: refs/heads/master" else []
    try:
        ci.main(parser.parse_args([str(matrix), *branch, "--install", install, "--out", str(path)]))
    except BadInput as error:
        files.say(f"no workflow: {error}")
    else:
        files.written.append(path.as_posix())


def _head() -> str:
    """Return the text of `.git/HEAD`, which names the branch; empty if there is no such file."""
    head = Path(".git/HEAD")
    return head.read_text(encoding="utf-8").strip() if head.is_file() else ""


# --- what a workflow claims ------------------------------------------------------------------------------------


def _describe_jobs(jobs: tuple[Job, ...], workflow: Path) -> Iterator[str]:
    """Yield lines on each leg: its combination, the packages it installs, and claims that it does not keep."""
    for job in jobs:
        yield f"{workflow}: job {job.name}: {format_count(len(job.legs), 'combination')}"
        for leg in job.legs:
            yield f"  {leg.combination}"
            yield f"    installs {_installs(leg)}"
            for claim in leg.claims:
                if claim.fate is Fate.NEVER:
                    yield f"    never installs {claim.name} {claim.value}: {claim.why}"
                elif claim.fate is Fate.OTHERWISE:
                    yield f"    claims {claim.name} {claim.value}, but {claim.why}"
        yield from (f"  {note}" for note in job.notes)
        empty = sum(any(claim.fate in {Fate.NEVER, Fate.OTHERWISE} for claim in leg.claims) for leg in job.legs)
        if empty:
            yield f"  {empty} of {format_count(len(job.legs), 'combination')} claimed but never installed"


def _installs(leg: Leg) -> str:
    own = [] if leg.extras is None else [f".[{','.join(leg.extras)}]" if leg.extras else "."]
    python = [f"Python {leg.python}"] if leg.python else []
    handed = [f"{claim.name} {claim.value} by {claim.why}" for claim in leg.claims if claim.fate is Fate.HANDED_ON]
    summary = ", ".join([*python, *own, *leg.requirements, *leg.unread]) or "nothing that can be read"
    return summary + (f" (perhaps {'; '.join(handed)})" if handed else "")

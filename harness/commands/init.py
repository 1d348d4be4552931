"""`simmatrix init [FOLDER]`: matrix, nox session and workflow for somebody's project; nothing is overwritten."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from harness import catalog, drafts, present, store, workflows
from harness.commands import ci
from harness.commands.run import tell
from harness.drafts import Case, Draft, Project
from harness.errors import BadInput
from harness.inputfiles import project
from harness.reporttypes import number
from harness.vocabulary import GYM, GYMNASIUM, Label
from harness.workflows import Fate, Job, Leg

HELP = (
    "Start in somebody's project: write a first matrix, a nox session and a GitHub workflow. With --from, the matrix is"
    " what a workflow really installs, and what it claims but never installs is listed."
)

NOT_SOURCES = frozenset({"build", "dist", "docs", "doc", "examples", "test", "tests", "node_modules", "site-packages"})
LARGEST = 2_000_000
"""Bytes of a file in which environments are looked for."""

NOX_LINES = """\
import sys

import nox

try:
    from harness import noxface
except ImportError as missing:  # nox was installed apart
    print(f"no sessions of cells here ({missing}): install simmatrix beside nox", file=sys.stderr)
else:
    noxface.cells(@NAMES@)
"""


class Started(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `init --json`; `jobs` are those of the workflow of --from."""

    schema: int = 1
    written: tuple[str, ...]
    kept: tuple[str, ...]
    jobs: tuple[Job, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `init`."""
    parser.add_argument("folder", metavar="FOLDER", nargs="?", type=Path, default=Path(), help="of the project [here]")
    parser.add_argument("--from", dest="workflow", type=Path, metavar="WORKFLOW", help="a workflow file of GitHub")
    parser.add_argument("--name", help="of the matrix [the project's]")
    parser.add_argument(
        "--offline", action="store_true", help="never ask the index; ranges wait, and so does the workflow"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document, and nothing else, on stdout")


@dataclass
class _Files:
    """What was written and what was there already."""

    say: Callable[[str], None]
    written: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)

    def write(self, path: Path, text: str) -> bool:
        """Write a file unless there is one; False where there was."""
        if path.exists():
            self.kept.append(path.as_posix())
            return False
        store.write_atomic(path, text.encode())
        self.say(f"wrote {path}")
        self.written.append(path.as_posix())
        return True


def main(args: argparse.Namespace) -> int:
    """Write what is missing; what is there stays as it is."""
    say = tell if args.json else print
    jobs = _jobs(args.workflow) if args.workflow else ()
    if not args.folder.is_dir():
        message = f"{args.folder}: is not a folder"
        raise BadInput(message)
    files = _Files(say)
    for line in _told(jobs, args.workflow):
        say(line)
    with chdir(args.folder):
        matrices = []
        for name, draft in _drafts(_project(), jobs, args).items():
            path = Path("matrices") / f"{name}.toml"
            if not files.write(path, drafts.text_of(draft, _template("matrix.toml.j2"))):
                say(f"{path}: is there already and stays as it is")
            matrices.append(path)
        _nox(matrices, files)
        cells = {path: len(catalog.load(str(path), tell, offline=args.offline).cells) for path in matrices}
        for path in matrices:
            _workflow(path, files)
        for path, count in cells.items():
            say(f"next: simmatrix run {path}  ({number(count, 'cell')})")
    if args.json:
        made = Started(written=tuple(files.written), kept=tuple(files.kept), jobs=jobs)
        sys.stdout.buffer.write(msgspec.json.encode(made, enc_hook=float) + b"\n")
    return 0


def _template(name: str) -> str:
    return (Path(present.__file__).parent / "templates" / name).read_text(encoding="utf-8")


# --- the project -----------------------------------------------------------------------------------------------


def _project() -> Project:
    texts = [path.read_text(encoding="utf-8") if path.is_file() else "" for path in map(Path, project.FILES)]
    if not any(texts):
        message = f"{Path.cwd()}: has neither pyproject.toml nor setup.py; name the folder of a project"
        raise BadInput(message)
    return drafts.read_project(texts[0], texts[1], Path.cwd().name)


def _case() -> Case | None:
    """The first environment that the sources register, in its newest version."""
    found = dict.fromkeys(_environments())
    for first, api in found:
        name = first.rpartition("-v")[0]
        newest = max((int(env.rpartition("-v")[2]), env) for env, _ in found if env.rpartition("-v")[0] == name)
        return Case(env=newest[1], api=api, more=len(found) - 1)
    return None


def _environments() -> Iterator[tuple[str, str]]:
    for path in sorted(Path().rglob("*.py")):
        if NOT_SOURCES & {*path.parts} or any(part.startswith(".") for part in path.parts):
            continue
        if path.stat().st_size <= LARGEST:
            text = path.read_text(encoding="utf-8", errors="replace")
            api = GYMNASIUM if "gymnasium" in text else GYM
            yield from ((env, api) for env in (drafts.registered(text) if "register" in text else ()))


def _drafts(about: Project, jobs: tuple[Job, ...], args: argparse.Namespace) -> dict[str, Draft]:
    """The matrices to be written, by their names."""
    name, case = _name(about, args.name), _case()
    if not args.workflow:
        return {name: drafts.of_project(about, case)}
    made = {job.name: drafts.of_legs(job.legs, args.workflow.name, case) for job in jobs}
    known = {job: draft for job, draft in made.items() if draft}
    if not known:
        message = f"{args.workflow}: no leg of it can be understood; `simmatrix init` alone starts from the project"
        raise BadInput(message)
    return {name if len(known) == 1 else f"{name}-{job}": draft for job, draft in known.items()}


def _name(about: Project, given: str | None) -> str:
    """What the matrix is called: files and folders are, too."""
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
        files.say(f"{noxfile}: is there already and stays as it is; its cells come with these lines:\n\n{lines}")


def _workflow(matrix: Path, files: _Files) -> None:
    """Write what `simmatrix ci` makes, beside the workflow of another matrix."""
    folder = Path(".github/workflows")
    path = folder / "simmatrix.yml"
    if path.exists() and f"ci {matrix} " not in path.read_text(encoding="utf-8", errors="replace"):
        path = folder / f"simmatrix-{matrix.stem}.yml"
    if path.exists():
        files.kept.append(path.as_posix())
        files.say(f"{path}: is there already and stays as it is; `simmatrix ci {matrix} --check {path}` compares")
        return
    parser = argparse.ArgumentParser()
    ci.add_arguments(parser)
    branch = ["--branch", "master"] if _head() == "ref: refs/heads/master" else []
    try:
        ci.main(parser.parse_args([str(matrix), *branch, "--out", str(path)]))
    except BadInput as error:
        files.say(f"no workflow: {error}")
    else:
        files.written.append(path.as_posix())


def _head() -> str:
    """What a checkout says of its branch."""
    head = Path(".git/HEAD")
    return head.read_text(encoding="utf-8").strip() if head.is_file() else ""


# --- what a workflow claims ------------------------------------------------------------------------------------


def _jobs(workflow: Path) -> tuple[Job, ...]:
    try:
        text = workflow.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        message = f"--from {workflow}: cannot be read: {getattr(error, 'strerror', None) or 'it is not UTF-8 text'}"
        raise BadInput(message) from None
    return workflows.read(text, str(workflow))


def _told(jobs: tuple[Job, ...], workflow: Path) -> Iterator[str]:
    """What each leg claims and installs."""
    for job in jobs:
        yield f"{workflow}: job {job.name}: {number(len(job.legs), 'combination')}"
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
            yield f"  {empty} of {number(len(job.legs), 'combination')} claimed and never installed as such"


def _installs(leg: Leg) -> str:
    own = [] if leg.extras is None else [f".[{','.join(leg.extras)}]" if leg.extras else "."]
    python = [f"Python {leg.python}"] if leg.python else []
    handed = [f"{claim.name} {claim.value} by {claim.why}" for claim in leg.claims if claim.fate is Fate.HANDED_ON]
    told = ", ".join([*python, *own, *leg.requirements, *leg.unread]) or "nothing that can be read"
    return told + (f" (perhaps {'; '.join(handed)})" if handed else "")

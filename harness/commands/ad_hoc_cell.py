"""Read one combination of requirements from the command line of `try` or `repair`, and plan its cell."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.judging.exercised import OWN
from harness.machine import interpreters
from harness.machine.console import tell
from harness.machine.files import given_files
from harness.machine.store import Store
from harness.matrix import overlay_recipes, plan
from harness.model import Case, Cell, Outcome, Phase, Plan, Repair, Subject, replace
from harness.model.errors import BadInput
from harness.model.schema import locate_errors
from harness.model.vocabulary import APIS, FAMILY, GYM, GYMNASIUM, HOST, InnerPath, PackageName, version_text
from harness.packages import package_under_test
from harness.packages.requirement_files import Inputs, inputs
from harness.packages.sources import checkouts
from harness.reports.answers import misspelt
from harness.running import open_matrix, scheduler
from harness.running.open_matrix import REUSED_FOR_HOURS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe the combination to try."""
    parser.add_argument(
        "requirements", metavar="REQUIREMENT", nargs="*", help="a requirement such as 'gymnasium[mujoco]==1.2.3'"
    )
    parser.add_argument(
        "-r",
        dest="files",
        type=Path,
        metavar="FILE",
        action="append",
        default=[],
        help="requirements.txt, pyproject.toml, pylock.toml or environment.yml; may be repeated",
    )
    parser.add_argument(
        "--subject", metavar="PATH", help="also install this project: a folder, a wheel or git+URL@REFERENCE"
    )
    parser.add_argument(
        "--extra", metavar="NAME", action="append", default=[], help="an extra of the pyproject.toml; may be repeated"
    )
    parser.add_argument(
        "--group",
        metavar="NAME",
        action="append",
        default=[],
        help="a dependency group of the pyproject.toml; may be repeated",
    )
    parser.add_argument(
        "--python", metavar="V", help="a version, a path, or `host` (default: of the active environment, or the newest)"
    )
    parser.add_argument(
        "--env",
        metavar="ID",
        action="append",
        default=[],
        help="an environment to run, such as Ant-v5; may be repeated",
    )
    parser.add_argument("--api", metavar="A", help="API of the environments, such as gym (default: found by their ids)")
    parser.add_argument(
        "--import",
        dest="imports",
        metavar="MODULE",
        action="append",
        default=[],
        help="import this module before an environment is made; may be repeated",
    )
    parser.add_argument(
        "--set", metavar="N=V", action="append", default=[], help="set an environment variable; may be repeated"
    )
    _add_resolver_options(parser)


def _add_resolver_options(parser: argparse.ArgumentParser) -> None:
    for option, meaning in RESOLVER_OPTIONS.items():
        parser.add_argument(option, metavar="R", action="append", default=[], help=meaning)
    parser.add_argument(
        "--overlay",
        metavar="PACKAGE",
        nargs="?",
        action="append",
        const=EVERY,
        default=[],
        help="patch releases with invalid metadata: of PACKAGE, or of all packages that have a recipe",
    )
    parser.add_argument(
        "--as-of", metavar="INSTANT", help="resolve as the package index stood then (UTC), such as 2024-01-31"
    )
    parser.add_argument(
        "--torch-backend",
        metavar="B",
        default="cpu",
        help="build of PyTorch: cpu, auto, cu126, ... (default: %(default)s)",
    )


EVERY = ":all:"
"""What `--overlay` means that names no package."""

RESOLVER_OPTIONS = {
    "--constraint": "limit the versions of a package if something needs it",
    "--override": "replace the requirements of all packages for this one",
    "--build-constraint": "limit the versions of build tools of source distributions",
    "--only-binary": "never build this package from source; `:all:`: no package",
}


def _subject(args: argparse.Namespace) -> Subject:
    """Return the package under test that `--subject` names, with the extras and groups of the command line."""
    remote = args.subject.startswith(checkouts.REPOSITORY)
    source = args.subject if remote else str(Path(args.subject).resolve())
    with locate_errors("--extra, --group"):
        extras, groups = (tuple(map(PackageName.canonical, names)) for names in (args.extra, args.group))
    return package_under_test.record_state(Subject(source=source, extras=extras, groups=groups), offline=args.offline)


@dataclass(frozen=True, kw_only=True, slots=True)
class CellInputs:
    """The requirement files and the `--subject` of a command line, as read."""

    inputs: Inputs
    subject: Subject | None


def read(args: argparse.Namespace) -> CellInputs:
    """Read the files. Print a note for each part that is not supported, or read unlike pip. Raises BadInput."""
    tested = _subject(args) if args.subject else None
    of_files = ([], []) if tested else (args.extra, args.group)
    given = inputs.read(args.files, extras=of_files[0], groups=of_files[1])
    for line in (*given.not_modelled, *given.notes):
        tell(f"note: {line}")
    return CellInputs(inputs=given, subject=tested)


def plan_cell(args: argparse.Namespace, read_before: CellInputs, opened: Store, runner: scheduler.Runner) -> Plan:
    """Return the one-cell plan, with its Python and its instant. Options are checked before the instant is stored."""
    given = read_before.inputs
    overlay, taken = _overlay(args.overlay)
    options = plan.TrialOptions(
        requirements=(*args.requirements, *taken, *given.requirements),
        listed=tuple(text for text in given.requirements if text not in args.requirements),
        overlay=overlay,
        # Which Python it will be is known only after the cell was resolved; the other options are checked before.
        python="host",
        envs=tuple(args.env),
        api=args.api,
        imports=tuple(args.imports),
        environment=dict(_variable(text) for text in args.set),
        constraints=(*args.constraint, *given.constraints),
        overrides=(*args.override, *given.overrides),
        build_constraints=(*args.build_constraint, *given.build_constraints),
        only_binary=(*args.only_binary, *given.only_binary),
        torch_backend=args.torch_backend,
        as_of=args.as_of,
        subject=read_before.subject,
        index=given.index,
        prerelease=given.prerelease,
    )
    options = replace(options, files=models(plan.single(options).cells[0].cases))
    if args.as_of is None:
        instant = opened.instant(plan.TRY_MATRIX, renew=runner.settings.fresh, hours=REUSED_FOR_HOURS)
        options = replace(options, instant=instant)
    (cell,) = plan.single(options).cells
    typed = (*cell.question.requirements, *args.constraint, *args.override, *args.build_constraint)
    misspelt.check(typed, tell, cell.question.index, offline=runner.settings.offline)
    python = _asked_python(args.python) if args.python else _python(cell, given, runner)
    brought = _detect_api(options, cell, python, runner)
    return plan.single(replace(options, python=_version(python), interpreter=python, brought=brought))


def _detect_api(options: plan.TrialOptions, cell: Cell, python: str, runner: scheduler.Runner) -> str | None:
    """Return the API that the requirements bring; None if the command line decides it, or if there is no lock.

    Raises BadInput if the lock has neither gymnasium nor gym.
    """
    env = plan.unspoken(options)
    if env is None:
        return None
    interpreter = interpreters.obtain(python, offline=runner.settings.offline)
    lock = runner.lock_of(cell, interpreter)[0] if interpreter else None
    brought = [api for api in (GYMNASIUM, GYM) if lock and api in lock.versions]
    if lock and not brought:
        message = (
            f"--env {env}: no requirement brings {' or '.join(FAMILY)}; add one of them, "
            f"or its API with --api ({', '.join(api for api in APIS if api not in FAMILY)}); {OWN}"
        )
        raise BadInput(message)
    return brought[0] if brought else None


def _overlay(given: Sequence[str]) -> tuple[tuple[Repair, ...], tuple[str, ...]]:
    """Return the repairs that `--overlay` asks for, and those of its values that are requirements, not names."""
    if not given:
        return (), ()
    recipes = open_matrix.recipes(Path("matrices"))
    # argparse takes a requirement that follows a bare `--overlay` for its value; it still counts as a requirement.
    names = [text for text in given if re.fullmatch(r"[A-Za-z0-9._-]+", text)]
    with locate_errors("--overlay"):
        wanted = [PackageName.canonical(name) for name in names]
        repairs = overlay_recipes.find_repairs(recipes, wanted if len(names) == len(given) else tuple(recipes))
    return repairs, tuple(text for text in given if text not in names and text != EVERY)


def models(cases: Iterable[Case]) -> dict[str, str]:
    """Return the user's own models that environments name, such as `mujoco:FILE.xml`: file name to text.

    The cell gets them in its HOME. A file that is not in this folder may be a model that the simulator brings.
    """
    texts = {}
    for case in cases:
        name = (case.env or "").removeprefix(f"{case.api}:")
        if (
            not name.endswith(MODELS)
            or case.api in FAMILY
            or (plan.brings_models(case.api) and not Path(name).exists())
        ):
            continue
        with locate_errors(f"--env {case.env}"):
            name = InnerPath.canonical(name)
        texts[name] = given_files.read_text(Path(name), f"--env {case.env}: {name}")
    return texts


MODELS = (".xml", ".urdf", ".sdf")


def _variable(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        message = f"--set {text}: write NAME=VALUE, as in --set MUJOCO_GL=osmesa"
        raise BadInput(message)
    return name, value


def _asked_python(text: str) -> str:
    """Return the value of `--python`. Raises BadInput if it is a path without a Python, or no version."""
    if "/" in text:
        if interpreters.find(text) is None:
            message = f"--python {text}: no such Python on this machine; name a version such as 3.11, or a path"
            raise BadInput(message)
    elif text != HOST:
        with locate_errors("--python"):
            version_text(text)
    return text


def _version(python: str) -> str:
    """Return the version that names the cell: for a path or `host` that of the interpreter, else the text itself."""
    interpreter = interpreters.find(python) if "/" in python or python == HOST else None
    return interpreter.version if interpreter else python


def _python(cell: Cell, given: Inputs, runner: scheduler.Runner) -> str:
    """Return the active environment's Python if it is allowed, else the newest one here on which the cell resolves.

    If the cell resolves on none, return the newest allowed one.
    """
    about = package_under_test.about(cell.subject) if cell.subject else None
    allowed = SpecifierSet(given.python or "") & SpecifierSet(about.python if about else "")
    active = interpreters.active_version()
    if active and allowed.contains(active, prereleases=True) and interpreters.find(active):
        return active
    minors = {found.minor: found for found in interpreters.available() if allowed.contains(found.version)}
    newest = sorted(minors.values(), key=lambda interpreter: Version(interpreter.version), reverse=True)
    for python in newest:
        lock, step = runner.lock_of(cell, python)
        # Only a failed resolution speaks against a Python, not trouble of the network or of this machine.
        if lock or step.outcome is not Outcome.FAILED or step.phase is not Phase.RESOLVE:
            return python.minor
    if newest:
        return newest[0].minor
    # No Python here is allowed: its absence is the answer, and no forbidden one is tried in its place.
    return _choose_version(allowed) if allowed else HOST


def _choose_version(allowed: SpecifierSet) -> str:
    """Return an allowed version that is not installed here: a pinned one, else the oldest. BadInput if none."""
    pinned = [each.version for each in allowed if each.operator == "==" and not each.version.endswith(".*")]
    version = next((v for v in (*pinned, *(f"3.{minor}" for minor in range(7, 100))) if allowed.contains(v)), None)
    if version is None:
        message = f"try: no Python version satisfies all requirements: {allowed}; name one with --python"
        raise BadInput(message)
    return version

"""`simmatrix try REQUIREMENT...`: one combination, answered in one line."""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness import (
    catalog,
    changes,
    checkouts,
    document,
    inputs,
    interpreters,
    knowledge,
    machine,
    plan,
    repairs,
    scheduler,
    store,
    subjects,
    tables,
    verdict,
)
from harness.commands import progress, reporting
from harness.commands.run import VERIFYING, tell
from harness.errors import BadInput
from harness.evidence import diagnosed
from harness.inputfiles import Inputs
from harness.model import Case, CaseRecord, Cell, CellRecord, Outcome, Phase, Plan, Repair, Subject, Verdict
from harness.reporttypes import UNTOLD, word
from harness.schema import located
from harness.signatures import Diagnosis, Signature
from harness.store import Store
from harness.verdict import Judgement
from harness.vocabulary import APIS, FAMILY, GYM, GYMNASIUM, HOST, InnerPath, PackageName, version_text

HELP = "Try one combination of requirements: lock, install, and run environments in it."
REUSED_FOR_HOURS = 24.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `try`."""
    parser.add_argument("requirements", metavar="REQUIREMENT", nargs="*", help="such as 'gymnasium[mujoco]==1.2.3'")
    parser.add_argument(
        "-r",
        dest="files",
        type=Path,
        metavar="FILE",
        action="append",
        default=[],
        help="requirements.txt, pyproject.toml, pylock.toml or environment.yml",
    )
    parser.add_argument("--subject", metavar="PATH", help="put this project, wheel or git+ADDRESS@REFERENCE on top")
    parser.add_argument("--extra", metavar="NAME", action="append", default=[], help="an extra of the pyproject.toml")
    parser.add_argument("--group", metavar="NAME", action="append", default=[], help="a group of the pyproject.toml")
    parser.add_argument("--python", metavar="V", help="version, `host` or path [the active environment's, or newest]")
    parser.add_argument("--env", metavar="ID", action="append", default=[], help="an environment id; may be repeated")
    parser.add_argument("--api", metavar="A", help="the API that the environments speak")
    parser.add_argument(
        "--import", dest="imports", metavar="MODULE", action="append", default=[], help="a module to import first"
    )
    parser.add_argument("--set", metavar="N=V", action="append", default=[], help="an environment variable of the cell")
    for option, meaning in RESOLVER_OPTIONS.items():
        parser.add_argument(option, metavar="R", action="append", default=[], help=meaning)
    parser.add_argument(
        "--overlay",
        metavar="PACKAGE",
        nargs="?",
        action="append",
        const=EVERY,
        default=[],
        help="repair releases that no resolver accepts: of this package, or of every one that has a recipe",
    )
    parser.add_argument("--as-of", metavar="INSTANT", help="resolve as the index stood then (UTC), e.g. 2024-01-31")
    parser.add_argument("--torch-backend", metavar="B", default="cpu", help="uv's: cpu, auto, cu126, ... [%(default)s]")
    parser.add_argument("--fresh", action="store_true", help="resolve and measure again")
    parser.add_argument("--offline", action="store_true", help="use what is in the caches, never the network")
    parser.add_argument("--verify", action="store_true", help=VERIFYING)
    parser.add_argument("--json", action="store_true", help="print the report document, and nothing else, on stdout")


EVERY = ":all:"
"""What `--overlay` means that names no package."""

RESOLVER_OPTIONS = {
    "--constraint": "bound a package without asking for it",
    "--override": "replace what other packages say of this one",
    "--build-constraint": "bound what sdists are built with",
    "--only-binary": "never build this package from source (`:all:` for every one)",
}


def main(args: argparse.Namespace) -> int:
    """Try it; 0 only for `works`, 1 where it does not, 3 where it cannot be told here."""
    tested = _subject(args) if args.subject else None
    of_files = ([], []) if tested else (args.extra, args.group)
    given = inputs.read(args.files, extras=of_files[0], groups=of_files[1])
    for line in (*given.not_modelled, *given.notes):
        tell(f"note: {line}")
    opened = store.open_store()
    settings = scheduler.Settings(fresh=args.fresh, offline=args.offline, verify=args.verify)
    with progress.Progress(1, 1, reporting.headline) as board:
        planned = _plan(args, given, tested, opened, scheduler.Runner(opened, settings, board))
        (record,) = scheduler.run(planned.cells, opened, settings, board)
    judged = verdict.judge(record)
    if args.json:
        here = machine.facts()
        locate = reporting.seen_from_here(opened.folder)
        facts = {here.id: here.facts}
        used, causes = reporting.probes(planned), knowledge.beside(opened.folder)
        made = document.build([record], [planned], facts, store.now(), locate, used, known=causes)
        sys.stdout.write(document.encode(made).decode())
    else:
        print(answer(record, judged, diagnosed(record, judged, knowledge.beside(opened.folder))))
    return 0 if judged.verdict is Verdict.WORKS else 3 if judged.verdict in UNTOLD else 1


# --- what is asked for -----------------------------------------------------------------------------------------


def _subject(args: argparse.Namespace) -> Subject:
    """The package under test, whose extras and groups are those asked for."""
    remote = args.subject.startswith(checkouts.REPOSITORY)
    source = args.subject if remote else str(Path(args.subject).resolve())
    with located("--extra, --group"):
        extras, groups = (tuple(map(PackageName.canonical, names)) for names in (args.extra, args.group))
    return subjects.settled(Subject(source=source, extras=extras, groups=groups), offline=args.offline)


def _plan(
    args: argparse.Namespace, given: Inputs, tested: Subject | None, opened: Store, runner: scheduler.Runner
) -> Plan:
    """The one-cell plan, its Python chosen and its instant set; what is wrong is said before anything is kept."""
    overlay, taken = _overlay(args.overlay)
    asked = plan.Asked(
        requirements=(*args.requirements, *taken, *given.requirements),
        overlay=overlay,
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
        subject=tested,
    )
    asked = replace(asked, files=models(plan.single(asked).cells[0].cases))
    if args.as_of is None:
        instant = opened.instant(plan.TRY_MATRIX, renew=args.fresh, hours=REUSED_FOR_HOURS)
        asked = replace(asked, as_of=instant)
    question = replace(plan.single(asked).cells[0].question, index=given.index)
    if given.prerelease:
        question = replace(question, prerelease=given.prerelease)
    cell = replace(plan.single(asked).cells[0], question=question)
    python = _asked_python(args.python) if args.python else _python(cell, given, runner)
    asked = replace(asked, python=_version(python), brought=_brought(asked, cell, python, runner))
    planned = plan.single(asked)
    (cell,) = planned.cells
    return replace(planned, cells=(replace(cell, python=python, question=question),))


def _brought(asked: plan.Asked, cell: Cell, python: str, runner: scheduler.Runner) -> str | None:
    """The API of environments where nothing on the command line tells it: that which the requirements bring."""
    env = plan.unspoken(asked)
    if env is None:
        return None
    interpreter = interpreters.obtain(python, offline=runner.settings.offline)
    lock = runner.lock_of(cell, interpreter)[0] if interpreter else None
    brought = [api for api in (GYMNASIUM, GYM) if lock and api in lock.versions]
    if lock and not brought:
        message = (
            f"--env {env}: nothing that is asked for brings {' or '.join(FAMILY)}; name one of them, too, "
            f"or what it speaks with --api ({', '.join(api for api in APIS if api not in FAMILY)})"
        )
        raise BadInput(message)
    return brought[0] if brought else None


def _overlay(given: Sequence[str]) -> tuple[tuple[Repair, ...], tuple[str, ...]]:
    """The repairs that `--overlay` asks for; and requirements, which follow it where it names no package."""
    if not given:
        return (), ()
    known = catalog.recipes(Path("matrices"))
    names = [text for text in given if re.fullmatch(r"[A-Za-z0-9._-]+", text)]
    with located("--overlay"):
        wanted = [PackageName.canonical(name) for name in names]
        found = repairs.chosen(known, wanted if len(names) == len(given) else tuple(known))
    return found, tuple(text for text in given if text not in names and text != EVERY)


def models(cases: Iterable[Case]) -> dict[str, str]:
    """Models of the user's own that environments name, as `mujoco:FILE.xml`: the cell gets them in its HOME.

    One that is not in this folder may be the simulator's, where that brings models of its own.
    """
    found = {}
    for case in cases:
        name = (case.env or "").removeprefix(f"{case.api}:")
        if (
            not name.endswith(MODELS)
            or case.api in FAMILY
            or (case.api in plan.BRING_MODELS and not Path(name).exists())
        ):
            continue
        with located(f"--env {case.env}"):
            name = InnerPath.canonical(name)
        try:
            found[name] = Path(name).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
            message = f"--env {case.env}: {name} cannot be read from this folder: {why}"
            raise BadInput(message) from None
    return found


MODELS = (".xml", ".urdf", ".sdf")


def _variable(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        message = f"--set {text}: write NAME=VALUE, as in --set MUJOCO_GL=osmesa"
        raise BadInput(message)
    return name, value


def _asked_python(text: str) -> str:
    """The value of `--python`."""
    if "/" in text:
        if interpreters.find(text) is None:
            message = f"--python {text}: there is no Python here that can be run"
            raise BadInput(message)
    elif text != HOST:
        with located("--python"):
            version_text(text)
    return text


def _version(python: str) -> str:
    """What cells are named after: the version of an interpreter given by its path."""
    found = interpreters.find(python) if "/" in python or python == HOST else None
    return found.version if found else python


def _python(cell: Cell, given: Inputs, runner: scheduler.Runner) -> str:
    """The active environment's Python if it can be had, else the newest that the requirements allow."""
    about = subjects.about(cell.subject) if cell.subject else None
    allowed = SpecifierSet(given.python or "") & SpecifierSet(about.python if about else "")
    active = interpreters.active_version()
    if active and allowed.contains(active, prereleases=True) and interpreters.find(active):
        return active
    minors = {found.minor: found for found in interpreters.available() if allowed.contains(found.version)}
    newest = sorted(minors.values(), key=lambda found: Version(found.version), reverse=True)
    for found in newest:
        lock, step = runner.lock_of(cell, found)
        if lock or step.outcome is not Outcome.FAILED or step.phase is not Phase.RESOLVE:
            return found.minor
    if newest:
        return newest[0].minor
    return _lacking(allowed) if allowed else HOST


def _lacking(allowed: SpecifierSet) -> str:
    """The oldest version that is allowed, where no interpreter here is."""
    pinned = [each.version for each in allowed if each.operator == "==" and not each.version.endswith(".*")]
    found = next((v for v in (*pinned, *(f"3.{minor}" for minor in range(7, 100))) if allowed.contains(v)), None)
    if found is None:
        message = f"try: no Python is allowed by all that was given: {allowed}; name one with --python"
        raise BadInput(message)
    return found


# --- the answer ------------------------------------------------------------------------------------------------


def answer(record: CellRecord, judged: Judgement, found: Sequence[Diagnosis] = ()) -> str:
    """One line for what works; for what does not, the line that says why and the next command to type.

    `found` are the known failures that fit, the deepest cause first.
    """
    if judged.verdict is Verdict.UNAVAILABLE:
        return f"unavailable: {judged.decisive}"
    told = f"{word(judged.verdict)}: {_tried(record, judged)}"
    if judged.verdict is Verdict.WORKS:
        return told
    why = (judged.decisive or "no line says why", *(line for one in found[:1] for line in _known(one.signature)))
    return "\n".join((told, *why, f"next: simmatrix show {shlex.quote(record.cell.id)}"))


def _known(failure: Signature) -> Iterable[str]:
    """Cause and remedy of a known failure, and where more is said."""
    yield f"cause: {failure.cause}"
    yield f"remedy: {changes.in_words(failure.remedy.plain)}"
    yield from (f"see: {reference}" for reference in failure.references[:1])


def _tried(record: CellRecord, judged: Judgement) -> str:
    """What was really tried, and of what: never more than that."""
    passed = {case.case: tuple(p.phase for p in case.phases if p.outcome is Outcome.PASSED) for case in record.cases}
    parts = []
    for phases in dict.fromkeys(names for names in passed.values() if names):
        shown = [_name(case) for case in record.cases if passed[case.case] == phases]
        parts.append(f"{', '.join(phases)} of {' and '.join(shown)}")
    if judged.phase and judged.verdict is not Verdict.WORKS:
        failed = [_name(case) for case in record.cases if _ended(case, judged.phase) is judged.phases[judged.phase]]
        ended = judged.phases[judged.phase]
        told = "could not be told" if ended is Outcome.INFRA else word(ended)
        parts.append(f"{judged.phase} {told}" + (f" of {' and '.join(failed)}" if failed else ""))
    where = f" on Python {record.python}" if record.python else ""
    tried = "; ".join(parts or ["nothing was tried"]) + where
    mended = [f"repaired: {repairs.described(one)}" for one in record.repairs]
    drawn = any(phase.phase is Phase.RENDER and phase.frames for case in record.cases for phase in case.phases)
    needed = tables.settings(record.supplied, record.installed or {}) if drawn else ()
    settings = [f"drawn with {', '.join(needed)}, which a user sets, too"] if needed else []
    return "; ".join(
        [
            tried,
            *settings,
            *mended,
            *(f"{name} not verified: {_why(record, Phase(name))}" for name in judged.unverified),
        ]
    )


def _name(case: CaseRecord) -> str:
    return case.env or case.case.removeprefix("import-")


def _ended(case: CaseRecord, phase: Phase) -> Outcome | None:
    return next((record.outcome for record in case.phases if record.phase is phase), None)


def _why(record: CellRecord, phase: Phase) -> str:
    told = (p.decisive for case in record.cases for p in case.phases if p.phase is phase and p.decisive)
    return next(told, "it was not reached")

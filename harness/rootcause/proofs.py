"""What a repair found, as a document: what failed, the remedy in lines to paste, and every run that shows it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from harness import changes, machine, present
from harness.display import VARIABLE, VIRTUAL
from harness.model import Cell, Change, Phase, Verdict
from harness.rootcause.bench import Trial
from harness.rootcause.lab import Lab, Run
from harness.rootcause.repairing import Part, Repaired, Status
from harness.store import now
from harness.vocabulary import required_name


class CauseEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A known failure that fits what was seen."""

    signature: str
    cause: str
    masks: bool
    references: tuple[str, ...] = ()


class RunEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One cell of the search: what was changed and why, and what it came to in every phase.

    `at_hand` is whether it had been measured before; `key` is that of its environment.
    """

    number: int
    why: str
    does: tuple[str, ...]
    change: dict[str, Any]
    verdict: Verdict
    phase: Phase | None
    decisive: str | None
    causes: tuple[str, ...]
    unverified: tuple[str, ...]
    lock_sha256: str | None
    key: str | None
    python: str | None
    seconds: float
    at_hand: bool


class PartEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the remedy. It is `necessary` where the cell fails without it, in the run `without`."""

    does: tuple[str, ...]
    change: dict[str, Any]
    necessary: bool | None
    without: int | None


class PasteEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The remedy as people write it: lines of files, variables, command lines."""

    requirements: tuple[str, ...]
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    environment: dict[str, str] = {}
    unset: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class RemedyEntry(msgspec.Struct, frozen=True, kw_only=True):
    """What cures. `moved` are packages that the user had bounded otherwise and without which nothing was found.

    `sufficient` is whether the cell with the whole of it was measured here, in every phase, and works: run `proof`,
    which has its lock.
    """

    way: str
    why: str
    does: tuple[str, ...]
    change: dict[str, Any]
    moved: tuple[str, ...]
    parts: tuple[PartEntry, ...]
    necessary: bool
    sufficient: bool
    proof: int
    cell: str
    unverified: tuple[str, ...]
    paste: PasteEntry


class RepairDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `repair`: `repair.json`, and its `--json`.

    `measured` counts the runs that were not at hand, `built` the environments that had to be made, `bound` the tests
    that binary searches for single culprits need at most, where there was anything to search.
    """

    schema: int = 1
    generated: str
    cell: str
    status: Status
    decisive: str | None
    causes: tuple[CauseEntry, ...]
    remedy: RemedyEntry | None
    runs: tuple[RunEntry, ...]
    measured: int
    built: int
    bound: int
    seconds: float
    stopped: str | None
    left: tuple[str, ...]
    told: tuple[str, ...]
    machine: str
    facts: dict[str, Any]
    command: str
    lock: str | None = None
    files: tuple[str, ...] = ()


def document(lab: Lab, repaired: Repaired, command: str) -> RepairDocument:
    """All that a repair found."""
    here = machine.facts()
    before = repaired.before
    return RepairDocument(
        generated=now(),
        cell=lab.base.id,
        status=repaired.status,
        decisive=before.judged.decisive,
        causes=tuple(
            CauseEntry(
                signature=str(one.signature.id),
                cause=one.signature.cause,
                masks=one.signature.masks,
                references=one.signature.references,
            )
            for one in before.found
        ),
        remedy=_remedy(lab, repaired) if repaired.change and repaired.proof else None,
        runs=tuple(_run(number, one) for number, one in enumerate(lab.runs, start=1)),
        measured=lab.bench.runs,
        built=len(lab.bench.built),
        bound=repaired.bound,
        seconds=round(lab.seconds, 1),
        stopped=repaired.stopped,
        left=repaired.left,
        told=repaired.told,
        machine=here.id,
        facts=dict(here.facts),
        command=command,
    )


def _run(number: int, one: Run) -> RunEntry:
    judged, record = one.trial.judged, one.trial.record
    return RunEntry(
        number=number,
        why=one.why,
        does=changes.described(one.change),
        change=changes.plain(one.change),
        verdict=judged.verdict,
        phase=judged.phase,
        decisive=judged.decisive,
        causes=tuple(str(each.signature.id) for each in one.trial.found),
        unverified=judged.unverified,
        lock_sha256=record.lock_sha256,
        key=record.key,
        python=record.python,
        seconds=one.trial.seconds,
        at_hand=one.trial.at_hand,
    )


def _remedy(lab: Lab, repaired: Repaired) -> RemedyEntry:
    change, proof = repaired.change or Change(), repaired.proof or repaired.before
    return RemedyEntry(
        way=str(repaired.way),
        why=repaired.why,
        does=changes.described(change),
        change=changes.plain(change),
        moved=repaired.moved,
        parts=tuple(_part(lab, one) for one in repaired.parts),
        necessary=all(one.without is not None for one in repaired.parts),
        sufficient=proof.works and lab.shown(proof) is not None,
        proof=_number(lab, lab.shown(proof) or proof),
        cell=proof.cell.id,
        unverified=proof.judged.unverified,
        paste=paste(proof.cell, change),
    )


def _part(lab: Lab, one: Part) -> PartEntry:
    return PartEntry(
        does=changes.described(one.change),
        change=changes.plain(one.change),
        necessary=True if one.without else None,
        without=_number(lab, one.without) if one.without else None,
    )


def _number(lab: Lab, trial: Trial) -> int:
    return next(number for number, one in enumerate(lab.runs, start=1) if one.trial is trial)


def page(made: RepairDocument) -> str:
    """The document as people read it (the text of `templates/repair.md.j2`, filled)."""
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - start-up

    environment = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True, autoescape=False)
    environment.filters |= {"cell": present.filters()["cell"]}
    template = (Path(__file__).parent.parent / "templates" / "repair.md.j2").read_text(encoding="utf-8")
    said: dict[str, Any] = {name: getattr(made, name) for name in made.__struct_fields__}
    lines = list(_paste(made.remedy.paste)) if made.remedy else []
    return environment.from_string(template).render(**said, lines=[line.strip() for line in lines])


# --- lines to paste --------------------------------------------------------------------------------------------


def paste(cell: Cell, change: Change) -> PasteEntry:
    """The cell with its remedy, in the forms that people use."""
    question = cell.question
    changed = {*map(required_name, change.requirements)}
    environment = {name: value for name, value in change.environment.items() if value}
    notes = tuple(_notes(change))
    if environment.get(VARIABLE) == VIRTUAL:
        del environment[VARIABLE]
        notes = (*notes, "run the program under a virtual display: xvfb-run -a python ...")
    return PasteEntry(
        requirements=tuple(line for line in question.requirements if required_name(line) in changed),
        constraints=change.constraints,
        overrides=change.overrides,
        build_constraints=change.build_constraints,
        environment=environment,
        unset=tuple(name for name, value in change.environment.items() if not value),
        commands=tuple(_commands(cell, change)),
        notes=notes,
    )


def _notes(change: Change) -> Iterator[str]:
    if change.python:
        yield f"take Python {change.python}"
    if change.overlay:
        yield f"no index has the repaired {' and '.join(change.overlay)}; the lock names the wheel by its hash"
    if change.build_variables:
        yield f"set for builds: {' '.join(f'{name}={value}' for name, value in change.build_variables.items())}"
    if change.uninstall:
        yield f"remove {' '.join(change.uninstall)}"


def _commands(cell: Cell, change: Change) -> Iterator[str]:
    """Command lines of uv and pip that install it, where they can say all of it, and that of `try` that repeats it."""
    question = cell.question
    lines = shlex.join([*question.requirements, *question.constraints])
    if not change.overlay:
        more = [("--build-constraints build-constraints.txt", question.build_constraints),
                ("--overrides overrides.txt", question.overrides)]  # fmt: skip
        options = [option for option, there in more if there]
        options += [f"--only-binary {name}" for name in question.only_binary]
        options += [f"--exclude-newer {change.as_of}"] if change.as_of else []
        options += [f"--python {change.python}"] if change.python else []
        yield " ".join(["uv pip install", *options, lines])
        if not (change.as_of or question.overrides):
            building = "PIP_CONSTRAINT=build-constraints.txt " if question.build_constraints else ""
            binary = [f"--only-binary {name}" for name in question.only_binary]
            yield " ".join([f"{building}python{change.python or ''} -m pip install", *binary, lines])
    tried = trying(cell)
    if tried:
        yield tried


def trying(cell: Cell) -> str | None:
    """The `try` that measures a cell; None where its command line cannot say all of it."""
    question = cell.question
    beyond = question.absent or question.build_variables or cell.files or cell.bring or cell.system or cell.needs
    if beyond or cell.subject or any(case.kwargs or case.required or case.picture for case in cell.cases):
        return None
    options: list[tuple[str, Iterable[str]]] = [
        ("--constraint", question.constraints),
        ("--override", question.overrides),
        ("--build-constraint", question.build_constraints),
        ("--only-binary", question.only_binary),
        ("--overlay", dict.fromkeys(one.name for one in question.overlay)),
        ("--env", [case.env for case in cell.cases if case.env]),
        ("--set", _set(cell.environment, cell.empty)),
        ("--as-of", [question.snapshot] if question.snapshot else []),
        ("--python", [cell.python] if "/" not in cell.python else []),
    ]
    words = [word for option, values in options for value in values for word in (option, value)]
    apis = {case.api for case in cell.cases if case.api}
    api = ["--api", *apis] if len(apis) == 1 else []
    imports = [word for case in cell.cases[:1] for name in case.imports for word in ("--import", name)]
    return shlex.join(["simmatrix", "try", *question.requirements, *words, *api, *imports])


def _set(environment: Mapping[str, str], empty: Iterable[str]) -> Iterator[str]:
    yield from (f"{name}={value}" for name, value in environment.items())


# --- in words --------------------------------------------------------------------------------------------------


def lines(made: RepairDocument) -> Iterator[str]:
    """What people read of it."""
    before = made.runs[0]
    if made.status is Status.GREEN:
        yield f"{made.cell} works: there is nothing to repair"
        return
    yield f"{made.cell}: {_ended(before)}"
    if before.decisive:
        yield f"  {before.decisive}"
    if made.status is Status.UNTOLD:
        yield "this says nothing about the packages, so there is nothing to repair; mend that and type the same again"
        return
    for cause in made.causes[:1]:
        yield f"cause: {cause.cause} [{cause.signature}]"
    yield ""
    yield from _found(made, made.remedy) if made.remedy else _nothing(made)
    yield from (f"note: {one}" for one in made.told)
    spent = f"{made.measured} runs, {made.built} environments built"
    bounded = f" (binary searches need {made.bound} tests at most)" if made.bound else ""
    yield f"{spent}{bounded}, {made.seconds:.0f} s"
    yield from (f"written: {name}" for name in made.files)


def _found(made: RepairDocument, remedy: RemedyEntry) -> Iterator[str]:
    if remedy.moved:
        yield f"cannot be cured without moving {' and '.join(remedy.moved)}, which you bounded; the nearest that works:"
    yield f"remedy: {'; '.join(remedy.does)}"
    yield from _paste(remedy.paste)
    for part in remedy.parts:
        does = "; ".join(part.does)
        if part.without is None:
            yield f"necessary: not shown for {does}"
        else:
            yield f"necessary: without {does} it fails (run {part.without}: {_ended(made.runs[part.without - 1])})"
    proof = made.runs[remedy.proof - 1]
    if remedy.sufficient:
        open_ends = f", not verified: {', '.join(remedy.unverified)}" if remedy.unverified else ""
        yield f"sufficient: with it every check passes (run {remedy.proof}, {proof.seconds:.0f} s{open_ends})"
    if made.stopped:
        yield f"stopped short: {made.stopped}; a smaller change may do"


def _paste(paste: PasteEntry) -> Iterator[str]:
    files = {
        "requirements.txt": paste.requirements,
        "constraints.txt": paste.constraints,
        "overrides.txt": paste.overrides,
        "build-constraints.txt": paste.build_constraints,
    }
    for name, content in files.items():
        yield from (f"  {name}: {line}" for line in content)
    yield from (f"  export {name}={shlex.quote(value)}" for name, value in paste.environment.items())
    yield from (f"  unset {name}" for name in paste.unset)
    yield from (f"  {note}" for note in paste.notes)
    yield from (f"  $ {command}" for command in paste.commands)


def _nothing(made: RepairDocument) -> Iterator[str]:
    if made.status is Status.STOPPED:
        yield f"stopped short: {made.stopped}; not tried yet: {', '.join(made.left)}"
    else:
        tried = max(len(made.runs) - 1, 0)
        yield f"nothing that was tried cures it ({tried} {'change' if tried == 1 else 'changes'})"


def _ended(run: RunEntry) -> str:
    told = str(run.verdict).replace("_", " ")
    return f"{told} in {run.phase}" if run.phase and run.verdict is not Verdict.WORKS else told

"""Write a cell with its remedy in forms to paste: lines of files, variables, command lines."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator

import msgspec

from harness.model import Cell, Change
from harness.model.vocabulary import required_name

DISPLAY, VIRTUAL = "DISPLAY", "virtual"


class PasteEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The remedy in forms to paste: lines of files, variables, command lines."""

    requirements: tuple[str, ...]
    constraints: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    build_constraints: tuple[str, ...] = ()
    environment: dict[str, str] = {}
    unset: tuple[str, ...] = ()
    commands: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def paste(cell: Cell, change: Change) -> PasteEntry:
    """Return the cell with its remedy in forms to paste."""
    question = cell.question
    changed = {*map(required_name, change.requirements)}
    environment = {name: value for name, value in change.environment.items() if value}
    notes = tuple(_notes(change))
    if environment.get(DISPLAY) == VIRTUAL:
        del environment[DISPLAY]
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
    """Yield uv and pip commands that install the cell, if they can express it, and the `try` that repeats it."""
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
            # Older pips have no --build-constraint; their builds read PIP_CONSTRAINT.
            building = "PIP_CONSTRAINT=build-constraints.txt " if question.build_constraints else ""
            binary = [f"--only-binary {name}" for name in question.only_binary]
            yield " ".join([f"{building}python{change.python or ''} -m pip install", *binary, lines])
    tried = trying(cell)
    if tried:
        yield tried


def trying(cell: Cell) -> str | None:
    """Return the `try` command that measures a cell; None if its options cannot express the cell."""
    question = cell.question
    beyond = question.absent or question.build_variables or cell.files or cell.bring or cell.system or cell.needs
    if beyond or cell.subject or cell.empty or any(case.kwargs or case.required or case.picture for case in cell.cases):
        return None
    options: list[tuple[str, Iterable[str]]] = [
        ("--constraint", question.constraints),
        ("--override", question.overrides),
        ("--build-constraint", question.build_constraints),
        ("--only-binary", question.only_binary),
        ("--overlay", dict.fromkeys(one.name for one in question.overlay)),
        ("--env", [case.env for case in cell.cases if case.env]),
        ("--set", [f"{name}={value}" for name, value in cell.environment.items()]),
        ("--as-of", [question.snapshot] if question.snapshot else []),
        ("--python", [cell.python] if "/" not in cell.python else []),
    ]
    words = [word for option, values in options for value in values for word in (option, value)]
    apis = {case.api for case in cell.cases if case.api}
    api = ["--api", *apis] if len(apis) == 1 else []
    imports = [word for case in cell.cases[:1] for name in case.imports for word in ("--import", name)]
    return shlex.join(["simmatrix", "try", *question.requirements, *words, *api, *imports])


def lines(paste: PasteEntry) -> Iterator[str]:
    """Yield each entry as a line, with the file that it belongs in."""
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

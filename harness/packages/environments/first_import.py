"""Import packages that compile at their first import once, at the install, before their environment is sealed.

Nothing that a probe writes is kept, so that each would compile again, and might find what another machine has.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from harness.machine import debian_packages, process, this_machine
from harness.machine.files.guarded_files import log_text
from harness.machine.store import digest, open_store, write_atomic
from harness.model import Finding, Level, Outcome, Phase, Question, Step
from harness.model.machine_trouble import SHOT, machine_trouble
from harness.model.schema import load_toml
from harness.model.vocabulary import ModuleName, PackageName, SystemPackage
from harness.packages import uv_command
from harness.packages.environments import bytecode
from harness.packages.step_failed import StepFailed
from harness.standalone.failures.lines import decisive_line, describe_death, normalise, shorten_line

FILE = Path(__file__).with_suffix(".toml")
LIMITS = process.Limits(seconds=1800.0)


class Recipe(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A package that compiles when its modules are first imported, and the Debian packages that this needs."""

    name: PackageName
    modules: Annotated[tuple[ModuleName, ...], msgspec.Meta(min_length=1)]
    system: tuple[SystemPackage, ...] = ()
    reason: str


class _Recipes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    package: tuple[Recipe, ...]


@cache
def _recipes(file: Path) -> tuple[Recipe, ...]:
    return load_toml(file.read_text(encoding="utf-8"), _Recipes, file.name).package


def recipes(names: Collection[str]) -> tuple[Recipe, ...]:
    """Return the recipes of those of these packages that compile at their first import."""
    return tuple(one for one in _recipes(FILE) if one.name in names)


def marks(names: Collection[str], question: Question) -> tuple[str, ...]:
    """Return a digest of what compiles at import and its build variables, for the environment's key; else nothing."""
    matches = recipes(names)
    modules = [(str(one.name), [str(name) for name in one.modules]) for one in matches]
    return (digest("warmed", modules, question.build_variables),) if matches else ()


def warm(path: Path, names: Collection[str], question: Question) -> tuple[Finding, ...]:
    """Import what compiles, in an environment whose files are its own.

    Raises StepFailed: a compiler that fails is a failed install.
    """
    findings = []
    for recipe in recipes(names):
        _import(path, recipe, question)
        text = f"{recipe.name} was compiled by its first import: {recipe.reason}"
        findings.append(Finding(check="install.compiled", level=Level.NOTE, text=text))
    return tuple(findings)


def _import(path: Path, recipe: Recipe, question: Question) -> None:
    base = this_machine.base_environment()
    with uv_command.scratch() as work:
        home = work / "home"
        home.mkdir()
        completed = process.run(
            process.Command(
                argv=(str(path / "bin" / "python"), "-s", "-c", f"import {', '.join(recipe.modules)}"),
                cwd=home,
                env={
                    **base,
                    "PATH": f"{path / 'bin'}:{base['PATH']}",
                    "VIRTUAL_ENV": str(path),
                    # Byte code is compiled and kept apart (`bytecode`), never in the environment.
                    "PYTHONDONTWRITEBYTECODE": "1",
                    **question.build_variables,
                },
                limits=LIMITS,
                log=work / "import.log",
                profile=process.Profile.CELL,
                home=home,
                shielded=bytecode.shielded(path / "bin" / "python"),
                writable=(path,),
            )
        )
        places = {
            **uv_command.places(),
            str(path): "$ENV",
            str(home): "$HOME",
            str(process.temporary(home)): "$TMP",
            str(work): "$BUILD",
        }
        text = normalise(log_text(completed.log), places)
    if completed.exit_code == 0:
        return
    log = open_store().evidence(f"install-{path.name}") / f"{recipe.name}.log"
    write_atomic(log, text.encode())
    outcome, decisive = _judge_failure(completed, text)
    raise StepFailed(
        Step(
            phase=Phase.INSTALL,
            outcome=outcome,
            decisive=shorten_line(f"{recipe.name}, compiled by its first import: {decisive}"),
            log=open_store().relative(log),
            findings=tuple(_missing(recipe.system)),
        )
    )


def _judge_failure(completed: process.Completed, text: str) -> tuple[Outcome, str]:
    if completed.timed_out:
        return Outcome.TIMED_OUT, f"no end within {LIMITS.seconds:g} s"
    if completed.killed or completed.out_of_memory:
        return Outcome.INFRA, f"it was ended: {completed.killed or f'more than {LIMITS.memory_mb} MB of memory'}"
    if completed.shot:
        return Outcome.INFRA, f"it was {SHOT}"
    decisive = decisive_line(text) or describe_death(completed.exit_code, completed.signal, text)
    trouble = machine_trouble(text, decisive, completed.least_room_mb)
    return (Outcome.INFRA if trouble else Outcome.FAILED), decisive


def _missing(names: Iterable[str]) -> Iterable[Finding]:
    """Yield a note on missing Debian packages, for lack of which the compiler may have failed."""
    missing = debian_packages.describe_missing(tuple(names))
    if missing:
        yield Finding(check="install.system", level=Level.NOTE, text=missing)

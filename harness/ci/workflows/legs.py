"""Find the versions that each leg of a workflow claims by its matrix, and the packages that its steps install.

Steps are followed in their order: those whose `if` a leg's values turn off are left out, `pip`, `uv pip` and `conda`
commands are read, setup actions are asked for their Python. What scripts, containers and other actions do with a value
is not seen; that it was handed to them is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name

from harness.ci.workflows import expressions, shell
from harness.ci.workflows.combinations import Combination
from harness.ci.workflows.expressions import UNKNOWN, text_of
from harness.ci.workflows.shell import remove_marks
from harness.model import requirement_texts

SETUPS = ("/setup-python", "/setup-uv", "/setup-miniconda", "/setup-micromamba", "/install-pinned-python")
"""Ends of the names of actions that provide the Python of their `python-version`."""

_VERSION = re.compile(r"\s*(?:[<>=~!^]=?=?\s*)?v?\d[\w.*+-]*(?:\s*,.*)?")
_UNREADABLE = "?"


class Fate(StrEnum):
    """The fate of a value that a matrix names."""

    INSTALLED = "installed"
    HANDED_ON = "handed on"
    OTHERWISE = "otherwise"
    NEVER = "never"


@dataclass(frozen=True, kw_only=True, slots=True)
class Claim:
    """One value of a leg and what became of it; `why` completes the sentence."""

    name: str
    value: str
    fate: Fate
    why: str = ""

    @property
    def requirement(self) -> Requirement | None:
        """Return the value as a requirement, if its name is a package's, such as `numpy-version: ">=2.1"`."""
        specifiers = _specifiers(self.value) if _VERSION.fullmatch(self.value) else None
        try:
            return Requirement(f"{_package(self.name)}{specifiers}") if specifiers else None
        except InvalidRequirement:
            return None


@dataclass(frozen=True, kw_only=True, slots=True)
class Leg:
    """One combination of one job: its claims and the packages it installs, as far as they can be read.

    `extras` is None where the project itself is not installed; `unread` are files, addresses and the like.
    """

    combination: Combination
    python: str | None
    requirements: tuple[str, ...]
    extras: tuple[str, ...] | None
    unread: tuple[str, ...]
    claims: tuple[Claim, ...]


def leg(job: Mapping[str, Any], combination: Combination) -> Leg:
    """Follow the steps of a job with the values of one combination."""
    followed = _LegState(combination.values)
    around = [job.get(key) for key in ("runs-on", "container", "services", "env", "defaults", "with")]
    followed.hand_on(around, "the job's own settings")
    environment = followed.variables(job.get("env"), {})
    for step in _steps(job):
        # None means that only GitHub can decide. Such a step is kept: one is left out only where that is sure.
        if expressions.holds(step.get("if", True), followed.contexts(environment)) is not False:
            followed.step(step, followed.variables(step.get("env"), environment))
    return Leg(
        combination=combination,
        python=followed.python,
        requirements=tuple(str(requirement) for requirement in followed.packages.values()),
        extras=tuple(sorted(followed.extras)) if followed.extras is not None else None,
        unread=tuple(dict.fromkeys(followed.unread)),
        claims=tuple(followed.claim(name, text_of(value), job) for name, value in combination.values.items()),
    )


@dataclass
class _LegState:
    """The state of a leg after the steps so far."""

    values: Mapping[str, Any]
    python: str | None = None
    packages: dict[str, Requirement] = field(default_factory=dict)
    extras: set[str] | None = None
    unread: list[str] = field(default_factory=list)
    installing: set[str] = field(default_factory=set)
    handed: dict[str, str] = field(default_factory=dict)
    marked: dict[str, str] = field(default_factory=dict)

    # --- values ---

    def contexts(self, environment: Mapping[str, str]) -> dict[str, Any]:
        """Return the contexts that decide expressions: `matrix` and `env`."""
        return {"matrix": dict(self.values), "env": {name: remove_marks(text) for name, text in environment.items()}}

    def variables(self, table: object, around: Mapping[str, str]) -> dict[str, str]:
        """Return environment variables, with marks around values of the matrix."""
        own = table if isinstance(table, dict) else {}
        return {**around, **{str(name): self.filled(text_of(value), around) for name, value in own.items()}}

    def filled(self, text: str, environment: Mapping[str, str]) -> str:
        """Return the text with its expressions replaced, each marked with the names that it took its value from."""

        def write(expression: str, value: Any) -> str:
            marks = set(expressions.names_in(expression, "matrix"))
            for name in expressions.names_in(expression, "env"):
                marks |= _names(environment.get(name, ""))
            return f"\x01{','.join(sorted(marks))}\x02{_UNREADABLE if value is UNKNOWN else text_of(value)}\x03"

        return expressions.substitute(text, write, self.contexts(environment))

    # --- steps ---

    def step(self, step: Mapping[str, Any], environment: Mapping[str, str]) -> None:
        """Follow one step that is run."""
        action, given = text_of(step.get("uses")), step.get("with")
        for name, value in given.items() if isinstance(given, dict) else ():
            text = self.filled(text_of(value), environment)
            if name == "python-version" and action.partition("@")[0].endswith(SETUPS):
                self.python = remove_marks(text)
                self.installing |= _names(text)
            else:
                self.hand_on([value], action)
        if "run" in step:
            self.script(self.filled(text_of(step["run"]), environment), environment)
        self.hand_on([step.get("env"), step.get("working-directory"), step.get("shell")], "environment variables")

    def script(self, text: str, environment: Mapping[str, str]) -> None:
        """Follow the commands of a step."""
        for name, value in environment.items():
            # In a replacement `re.sub` would read a backslash as an escape.
            text = re.sub(rf"\$(?:{re.escape(name)}\b|\{{{re.escape(name)}\}})", value.replace("\\", "\\\\"), text)
        for words in shell.commands(text):
            plain = [remove_marks(word) for word in words]
            names = {name for word in words for name in _names(word)}
            command = shell.install(plain)
            python = shell.python_of(plain)
            if command:
                self.install(command)
            if command or python:
                self.python = python or self.python
                self.installing |= names
            else:
                self.hand_on_names(names, f"`{' '.join(plain[:3])}{' ...' if plain[3:] else ''}`")
        # Last, since the first receiver counts: this is for values outside commands, as in the test of an `if`.
        self.hand_on_names(_names(text), "a script")

    def install(self, command: shell.Install) -> None:
        """Add or remove the packages of a command. An installed package is not replaced without need."""
        self.unread += command.files
        for word in command.words:
            if own := re.fullmatch(r"(?:\./?|\$?\{?\w*\}?/?dist/\*\S*)(?:\[([^]]*)\])?", word):
                self.extras = (self.extras or set()) | {extra.strip() for extra in (own[1] or "").split(",")} - {""}
                continue
            try:
                requirement = requirement_texts.requirement(word)
            except InvalidRequirement:
                self.unread.append(word)
                continue
            name = canonicalize_name(requirement.name)
            if name == "python":  # conda's
                continue
            if command.removes:
                self.packages.pop(name, None)
            elif requirement.specifier or requirement.url or command.upgrade or name not in self.packages:
                self.packages[name] = requirement

    def hand_on(self, parts: Iterable[object], to: str) -> None:
        """Note that these parts of the workflow hand on the matrix values that they use, with `to` as the receiver."""
        self.hand_on_names({name for text in _texts(list(parts)) for name in expressions.names(text, "matrix")}, to)

    def hand_on_names(self, names: Iterable[str], to: str) -> None:
        """Note the first receiver of each value; `*` stands for all values."""
        for name in names:
            for each in self.values if name == "*" else [name]:
                self.handed.setdefault(each, to)

    # --- the end ---

    def claim(self, name: str, value: str, job: Mapping[str, Any]) -> Claim:
        """Return the claim of one value, with its fate."""
        reached = name in self.installing or "*" in self.installing
        instead = self.instead(name, value)
        # An install of any version contradicts no value that reached an installing command in another form.
        if instead is not None and not (reached and instead == ""):
            return Claim(name=name, value=value, fate=Fate.OTHERWISE, why=instead or f"installs any {_package(name)}")
        if reached:
            return Claim(name=name, value=value, fate=Fate.INSTALLED)
        if name in self.handed:
            return Claim(name=name, value=value, fate=Fate.HANDED_ON, why=self.handed[name])
        # Labels and switches claim no version, so naming a leg or choosing its steps is a use of them.
        if not _VERSION.fullmatch(value) and name in _mentioned(job):
            return Claim(name=name, value=value, fate=Fate.HANDED_ON, why="names and conditions")
        return Claim(name=name, value=value, fate=Fate.NEVER, why=_why_never(name, job))

    def instead(self, name: str, value: str) -> str | None:
        """Return words on the version installed instead of the value: "" for any version, None if the value fits."""
        if not _VERSION.fullmatch(value):
            return None
        package = _package(name)
        if package == "python":
            return f"sets up Python {self.python}" if self.python not in {None, value} else None
        requirement = self.packages.get(package)
        if requirement is None or _specifiers(value) == requirement.specifier:
            return None
        return f"installs {requirement}" if requirement.specifier or requirement.url else ""


def _steps(job: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    steps = job.get("steps")
    return [step for step in steps if isinstance(step, dict)] if isinstance(steps, list) else []


def _package(name: str) -> str:
    """Return the package that an axis such as `gymnasium-version` is about."""
    return canonicalize_name(re.sub(r"[-_.]?(?:version|ver)s?$", "", name, flags=re.IGNORECASE) or name)


def _specifiers(value: str) -> SpecifierSet | None:
    text = value.strip()
    try:
        return requirement_texts.specifiers(text if text[:1] in "<>=~!^" else f"=={text}")
    except InvalidSpecifier:
        return None


def _why_never(name: str, job: Mapping[str, Any]) -> str:
    steps = _steps(job)
    using = [
        step for step in steps if name in _used([value for key, value in step.items() if key not in {"if", "name"}])
    ]
    if using:
        named = text_of(using[0].get("name")) or text_of(using[0].get("uses")) or text_of(using[0].get("run"))
        condition = text_of(using[0].get("if"))
        return f'the step "{named.splitlines()[0]}", which would, is left out by `if: {condition}`'
    return f"no step uses matrix.{name}"


def _mentioned(job: Mapping[str, Any]) -> frozenset[str]:
    """Return the matrix names used in the conditions of steps, and in the names of steps and of the job."""
    steps = _steps(job)
    conditions = (text_of(step.get("if")) for step in steps)
    inside = {name for condition in conditions for name in expressions.names_in(condition, "matrix")}
    return _used([job.get("name"), job.get("continue-on-error"), *(step.get("name") for step in steps)]) | inside


def _used(parts: Sequence[object]) -> frozenset[str]:
    return frozenset(name for text in _texts(parts) for name in expressions.names(text, "matrix"))


def _texts(part: object) -> Iterator[str]:
    """Yield every text inside a part of a workflow."""
    if isinstance(part, str):
        yield part
    inner = part.values() if isinstance(part, dict) else part if isinstance(part, list | tuple) else ()
    for each in inner:
        yield from _texts(each)


def _names(text: str) -> set[str]:
    return {name for marks in shell.MARK.findall(text) for name in marks.split(",") if name}

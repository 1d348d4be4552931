"""Build the line of candidates for a bisection: releases of a package, days of the index, Pythons of this machine."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.machine import interpreters
from harness.model import Cell, Change, Interpreter
from harness.model.errors import BadInput
from harness.model.schema import suggestion
from harness.model.vocabulary import Instant, required_name
from harness.packages import index
from harness.packages.index import Release
from harness.rootcause.repair import candidate_changes, times

DAY = re.compile(r"\d{4}-\d{2}-\d{2}")


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """One place on a line: its name, the change that produces its cell, and its upload time, if known."""

    name: str
    change: Change
    uploaded: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class LineOptions:
    """The options of a line: whether to include yanked releases and pre-releases, and whether to stay offline."""

    yanked: bool = False
    pre: bool = False
    offline: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidates:
    """The candidates of a line, oldest first. `left_out` says which releases are not on it, and why."""

    candidates: tuple[Candidate, ...]
    left_out: tuple[str, ...] = ()


# --- releases --------------------------------------------------------------------------------------------------


def of_package(cell: Cell, name: str, interpreter: Interpreter, options: LineOptions) -> Candidates:
    """Return the releases of a package that exist for the Python of a cell. Raises BadInput and IndexUnreachable."""
    question = cell.question
    releases = index.releases(name, question.index, cutoff=question.snapshot, offline=options.offline)
    # A platform wheel shows that the package is compiled; releases with an sdist alone would be built here.
    wheels = any(times.has_wheel(one.wheels, interpreter, native=True) for one in releases)
    binary = {name, ":all:"} & set(question.only_binary)
    reasons: dict[str, list[str]] = {}
    taken = []
    for release in releases:
        why = _find_exclusion(release, interpreter, options, source=not (wheels or binary))
        if why:
            reasons.setdefault(why, []).append(release.version)
        else:
            taken.append(
                Candidate(
                    name=release.version, change=pin_release(cell, name, release.version), uploaded=release.uploaded
                )
            )
    left_out = (f"{why}: {_listed(versions)}" for why, versions in reasons.items())
    return Candidates(candidates=tuple(taken), left_out=tuple(left_out))


def pin_release(cell: Cell, name: str, version: str) -> Change:
    """Return the change that pins a package: in the requirements or overrides if it is there, else as a constraint."""
    line = (f"{name}=={version}",)
    if name in map(required_name, cell.question.requirements):
        return Change(requirements=line)
    if name in map(required_name, cell.question.overrides):
        return Change(overrides=line)
    return Change(constraints=line)


def _find_exclusion(release: Release, interpreter: Interpreter, options: LineOptions, *, source: bool) -> str | None:
    """Return the reason to leave out a release; None if it fits."""
    if release.yanked and not options.yanked:
        return "yanked (--yanked includes them)"
    if Version(release.version).is_prerelease and not options.pre:
        return "pre-releases (--pre includes them)"
    if release.requires_python and not _allows(release.requires_python, interpreter.version):
        return f"not for Python {interpreter.minor}, according to their metadata"
    if not times.has_wheel(release.wheels, interpreter) and not (release.sdist and source):
        return f"without a wheel for Python {interpreter.minor} on this machine"
    return None


def _allows(specifier: str, version: str) -> bool:
    try:
        return SpecifierSet(specifier).contains(version, prereleases=True)
    except ValueError:  # nobody can read it; the resolver decides
        return True


def _listed(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{names[0]} ... {names[-1]} ({len(names)})"


# --- days ------------------------------------------------------------------------------------------------------


def of_days(cell: Cell, packages: Iterable[str], interpreter: Interpreter, options: LineOptions) -> Candidates:
    """Return the days on which one of these packages had an upload: their resolution can change on no other day.

    Each stands for the end of the day, UTC. The last one is the instant of the cell, if it has one. By the first day,
    all that the cell pins was uploaded.
    """
    question, pinned = cell.question, candidate_changes.pins(cell)
    days, first = set(), ""
    for name in packages:
        for release in index.releases(name, question.index, cutoff=question.snapshot, offline=options.offline):
            if release.uploaded and not _find_exclusion(release, interpreter, options, source=True):
                days.add(release.uploaded[:10])
                first = max(first, release.uploaded[:10]) if same(pinned.get(name, ""), release.version) else first
    candidates = [
        Candidate(name=day, change=Change(as_of=Instant.canonical(day))) for day in sorted(days) if day >= first
    ]
    if candidates and question.snapshot and candidates[-1].change.as_of != question.snapshot:
        # The end of that day is later than the cell's own instant, so the instant takes the place of the day.
        if candidates[-1].name == question.snapshot[:10]:
            candidates.pop()
        candidates.append(Candidate(name=question.snapshot, change=Change(as_of=question.snapshot)))
    return Candidates(candidates=tuple(candidates))


# --- Pythons ---------------------------------------------------------------------------------------------------


def of_pythons(cell: Cell) -> Candidates:
    """Return the Pythons of this machine, one CPython of each minor version."""
    newest: dict[str, Interpreter] = {}
    for installed in interpreters.available():
        if installed.implementation == "cpython":
            best = newest.get(installed.minor)
            newest[installed.minor] = max(filter(None, (best, installed)), key=lambda each: Version(each.version))
    cell_interpreter = interpreters.find(cell.python)
    # The end that stands for the cell as it is has to be its own interpreter, not a newer patch release of its minor.
    if cell_interpreter and cell_interpreter.implementation == "cpython":
        newest[cell_interpreter.minor] = cell_interpreter
    ordered = sorted(newest.values(), key=lambda interpreter: Version(interpreter.version))
    return Candidates(
        candidates=tuple(
            Candidate(name=one.minor, change=Change(python=cell.python if one is cell_interpreter else one.minor))
            for one in ordered
        )
    )


# --- ends ------------------------------------------------------------------------------------------------------


def place(line: Candidates, text: str, option: str) -> int:
    """Return the place of the candidate that a command-line option names. Raises BadInput."""
    names = [one.name for one in line.candidates]
    for number, name in enumerate(names):
        if same(name, text):
            return number
    message = f"{option} {text}: cannot be tried here{suggestion(text, names)}; {_choices(line)}"
    raise BadInput(message)


def day(line: Candidates, text: str, option: str) -> int:
    """Return the place of the last day that is not after the named one. Raises BadInput."""
    try:
        instant = Instant.canonical(text)
    except ValueError as error:
        message = f"{option}: {error}"
        raise BadInput(message) from None
    before = [number for number, one in enumerate(line.candidates) if (one.change.as_of or one.name) <= instant]
    if not before:
        message = f"{option} {text}: the packages did not exist yet; {_choices(line)}"
        raise BadInput(message)
    return before[-1]


def rank(name: str) -> Version | str:
    """Return the sort key of a candidate's name. Days and instants are sorted by their text."""
    return name if DAY.match(name) else Version(name)


def places(line: Candidates, version: str) -> tuple[int, ...]:
    """Return the places of a version on the line."""
    return tuple(number for number, one in enumerate(line.candidates) if same(one.name, version))


def same(name: str, text: str) -> bool:
    """Return whether two names are equal or denote the same version."""
    if name == text:
        return True
    try:
        return Version(name) == Version(text)
    except ValueError:
        return False


def _choices(line: Candidates) -> str:
    names = [one.name for one in line.candidates]
    listing = f"there are {_listed(names)}" if names else "there is nothing"
    return "; ".join((listing, *(f"left out as {why}" for why in line.left_out)))


def diff_locks(good: Mapping[str, str], bad: Mapping[str, str]) -> tuple[tuple[str, str | None, str | None], ...]:
    """Return the packages that differ between two locks, as (name, good version, bad version); None where absent."""
    names = sorted({*good, *bad})
    return tuple((name, good.get(name), bad.get(name)) for name in names if good.get(name) != bad.get(name))

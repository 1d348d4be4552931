"""Which versions work together: known-good combinations of packages, out of the document of `distilling`.

What was measured and what only follows from it are told apart: a `Combination` has cells that work, an `Inferred` has
none, and says between which it lies.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from harness import distilling
from harness.failure import CHANGING
from harness.model import CASE_PHASES, Phase
from harness.tables import settings
from harness.vocabulary import parsed_requirement, required_name

Plain = Mapping[str, Any]

WORKS = "works"
PASSED = "passed"
WAYS = "MUJOCO_GL"
"""A variable that is set in many cells as in any script: the other ones are tried for their own sake."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Wanted:
    """A package that was asked for, and which versions of it."""

    name: str
    versions: SpecifierSet
    text: str

    @classmethod
    def of(cls, text: str) -> Wanted:
        """From a requirement; its extras say nothing of what was measured. Raises ValueError."""
        found = parsed_requirement(text)
        if found.url or found.marker:
            message = f'"{text}" has {"an address" if found.url else "a marker"}; name a package, or `name>=version`'
            raise ValueError(message)
        return cls(name=required_name(text), versions=found.specifier, text=text)

    def fits(self, version: str | None) -> bool:
        """Whether a version is one of those."""
        return version is not None and self.versions.contains(version, prereleases=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class Query:
    """What was asked: packages, a Python (`3.11` or `3.11.7`), phases that have to have passed, an environment."""

    wanted: tuple[Wanted, ...]
    python: str | None = None
    needs: tuple[Phase, ...] = ()
    env: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the packages."""
        return tuple(one.name for one in self.wanted)


class Combination(msgspec.Struct, frozen=True, kw_only=True):
    """Versions that work together, as measured. `python`, `cell`, `lock` and what follows are those of one cell.

    `beside` are versions of other packages that were chosen, with which all of it works, too; `settings` are variables
    that have to be set for it, `repaired` releases that no resolver accepts as the index has them.
    """

    versions: dict[str, str]
    pythons: tuple[str, ...]
    machines: tuple[str, ...]
    measured: str
    cells: tuple[str, ...]
    beside: dict[str, tuple[str, ...]]
    cell: str
    machine: str
    python: str
    phases: dict[str, str]
    unverified: tuple[str, ...]
    environments: tuple[str, ...]
    settings: dict[str, str]
    repaired: tuple[str, ...]
    brought: tuple[str, ...]
    lock_sha256: str
    lock: str


class Red(msgspec.Struct, frozen=True, kw_only=True):
    """Combinations that do not work, for one cause: `causes` are signatures, `line` is what one of them says.

    `beside` are the versions of other packages that were chosen.
    """

    versions: tuple[dict[str, str], ...]
    beside: dict[str, tuple[str, ...]]
    pythons: tuple[str, ...]
    verdicts: tuple[str, ...]
    phase: str | None
    causes: tuple[str, ...]
    line: str | None
    reason: str | None
    link: str | None
    cells: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Known:
    """A measured cell, and what its lock holds; `axes` where it has none."""

    cell: Plain
    pins: Mapping[str, str]

    def version(self, name: str) -> str | None:
        """The version of a package, if it was there, or asked for where nothing could be locked."""
        return self.pins.get(name) or (None if self.pins else _version(self.cell["axes"].get(name)))

    @cached_property
    def python(self) -> str:
        """In full where it is known."""
        return str(self.cell["python"] or self.cell["axes"].get("python", ""))

    @property
    def minor(self) -> str:
        """Such as `3.11`."""
        return ".".join(self.python.split(".")[:2])

    @property
    def works(self) -> bool:
        """Whether all that was tried works."""
        return bool(self.cell["verdict"] == WORKS and self.pins)

    @property
    def chosen(self) -> dict[str, str]:
        """Packages that the matrix chose a version of, as they were there, or were asked for."""
        return {name: version for name in self.cell["axes"] if name != "python" and (version := self.version(name))}

    @property
    def variables(self) -> dict[str, str]:
        """Those that were set for their own sake."""
        return {name: value for name, value in self.cell["environment"].items() if name != WAYS}


def known(document: Plain) -> list[Known]:
    """The cells of a document with their versions."""
    pins = {sha: dict(map(tuple, lock)) for sha, lock in document["locks"].items()}
    return [Known(cell=cell, pins=pins.get(cell["lock"], {})) for cell in document["cells"]]


# --- what fits -------------------------------------------------------------------------------------------------


def fitting(cells: Iterable[Known], query: Query) -> list[Known]:
    """Cells that hold all that was asked for, whatever became of them."""
    return [one for one in cells if _holds(one, query) and _of_python(one, query.python) and _has(one, query.env)]


def good(cells: Iterable[Known], query: Query) -> list[Known]:
    """Those that work, and passed what was needed."""
    return [one for one in fitting(cells, query) if one.works and passed(one, query)]


def _holds(one: Known, query: Query) -> bool:
    return all(wanted.fits(one.version(wanted.name)) for wanted in query.wanted)


def _of_python(one: Known, python: str | None) -> bool:
    return python is None or f"{one.python}.".startswith(f"{python}.")


def _has(one: Known, env: str | None) -> bool:
    return env is None or any(_is(case, env) for case in one.cell["cases"])


def _is(case: Plain, env: str) -> bool:
    """Whether a case is of an environment, its id with or without what stands before it."""
    return env == case["env"] or env == (case["env"] or "").partition(":")[2]


def passed(one: Known, query: Query) -> bool:
    """Whether what was needed passed: in the environment asked for, if one was."""
    cases = [case["phases"] for case in one.cell["cases"] if query.env and _is(case, query.env)]
    return all(phases.get(phase) == PASSED for phases in cases or [one.cell["phases"]] for phase in query.needs)


# --- measured --------------------------------------------------------------------------------------------------


def combinations(document: Plain, cells: Iterable[Known], query: Query) -> list[Combination]:
    """What works, the newest first, by what was asked for in the order in which it was."""
    groups: dict[tuple[str, ...], list[Known]] = {}
    for one in good(cells, query):
        groups.setdefault(tuple(str(one.version(name)) for name in query.names), []).append(one)
    ordered = sorted(groups.items(), key=lambda group: newness(group[0]), reverse=True)
    return [_combination(document, dict(zip(query.names, versions, strict=True)), found) for versions, found in ordered]


def newness(versions: Iterable[str]) -> tuple[Version, ...]:
    """By which the newest of several combinations is the greatest."""
    return tuple(Version(version) for version in versions)


def _combination(document: Plain, versions: dict[str, str], found: Sequence[Known]) -> Combination:
    best = max(found, key=_merit)
    cell = best.cell
    alike = [one for one in found if _plainness(one) == _plainness(best)]
    needed = tuple(settings(cell["supplied"], best.pins))
    return Combination(
        versions=versions,
        pythons=tuple(sorted({one.python for one in found}, key=Version, reverse=True)),
        machines=tuple(sorted({one.cell["machine"] for one in found})),
        measured=max(one.cell["measured"] for one in found),
        cells=tuple(one.cell["id"] for one in found),
        beside=_beside(alike, best, versions),
        cell=cell["id"],
        machine=cell["machine"],
        python=best.python,
        phases=dict(cell["phases"]),
        unverified=tuple(cell["unverified"]),
        environments=tuple(dict.fromkeys(case["env"] for case in cell["cases"] if case["env"])),
        settings={**cell["environment"], **dict(text.split("=", 1) for text in needed)},
        repaired=tuple(f"{one['package']} {one['version']}" for one in cell["repairs"]),
        brought=tuple(cell.get("brought", ())),
        lock_sha256=cell["lock"],
        lock=distilling.lock_text(document, cell["lock"]),
    )


def _beside(found: Iterable[Known], one: Known, asked: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Versions of what else the matrix of one cell chose, in all that were found."""
    names = [name for name in one.chosen if name not in {*asked}]
    held = {name: {other.chosen[name] for other in found if name in other.chosen} for name in names}
    return {name: tuple(sorted(versions, key=Version, reverse=True)) for name, versions in held.items()}


def _plainness(one: Known) -> tuple[bool, ...]:
    """Whether nothing has to be done that nobody expects: repairs, folders brought, variables."""
    return not one.cell["repairs"], not one.cell.get("brought"), not one.variables


def _merit(one: Known) -> tuple[Any, ...]:
    """Of equal combinations the one to show: plain, most verified, the newest Python, and of the rest the newest."""
    verified = sum(one.cell["phases"].get(phase) == PASSED for phase in CASE_PHASES)
    return (
        _plainness(one),
        verified - len(one.cell["unverified"]),
        Version(one.python),
        newness(one.chosen[name] for name in sorted(one.chosen)),
        one.cell["measured"],
    )


# --- red -------------------------------------------------------------------------------------------------------


def red(cells: Sequence[Known], query: Query) -> list[Red]:
    """What fits and does not work, by its cause: first versions of which none work together, then the newest.

    Left out is what the same lock does elsewhere (then it is no matter of versions), and what a matrix broke itself.
    """
    asked = fitting(cells, query)
    fine = {one.cell["lock"] for one in cells if one.works}
    reds = [one for one in asked if one.cell["verdict"] != WORKS and not one.cell.get("own")]
    reds = [one for one in reds if one.cell["lock"] is None or one.cell["lock"] not in fine]
    said: dict[Any, set[str]] = {}
    for one in reds:
        said.setdefault(_line(one), set()).update(filter(None, [one.cell.get("reason")]))
    groups: dict[tuple[Any, ...], list[Known]] = {}
    for one in sorted(reds, key=lambda one: not one.cell.get("reason")):
        elsewhere = said[_line(one)] if len(said[_line(one)]) == 1 else ()
        cause = tuple(one.cell["causes"]) or one.cell.get("reason") or next(iter(elsewhere), None) or _line(one)
        groups.setdefault((one.cell["phase"], cause), []).append(one)
    told = [_red(found, query) for found in groups.values()]
    together = [{name: one.version(name) for name in query.names} for one in asked if one.works]
    return sorted(
        told, key=lambda one: (one.versions[0] not in together, newness(one.versions[0].values())), reverse=True
    )


def _line(one: Known) -> tuple[str | None, str]:
    """The phase and the line, without what differs between two lines about the same."""
    return one.cell["phase"], CHANGING.sub("…", one.cell["decisive"] or "")


def _red(found: Sequence[Known], query: Query) -> Red:
    cell = found[0].cell
    held = {tuple(str(one.version(name)) for name in query.names) for one in found}
    return Red(
        versions=tuple(dict(zip(query.names, one, strict=True)) for one in sorted(held, key=newness, reverse=True)),
        beside=_beside(found, found[0], query.names),
        pythons=tuple(sorted({one.minor for one in found}, key=Version, reverse=True)),
        verdicts=tuple(sorted({one.cell["verdict"] for one in found})),
        phase=cell["phase"],
        causes=tuple(cell["causes"]),
        line=cell["decisive"],
        reason=cell.get("reason"),
        link=cell.get("link"),
        cells=tuple(one.cell["id"] for one in found),
    )


# --- nothing known ---------------------------------------------------------------------------------------------


def relaxed(query: Query) -> Iterator[tuple[str, Query]]:
    """The same question with less asked, and in words what it then is, the least change first."""
    if query.needs:
        yield f"where nothing is said of {' and '.join(query.needs)}", replace(query, needs=())
    if query.env:
        yield f"with other environments than {query.env}", replace(query, env=None)
    if query.python:
        yield f"on other Pythons than {query.python}", replace(query, python=None)
    free = tuple(replace(one, versions=SpecifierSet()) for one in query.wanted)
    if any(one.versions for one in query.wanted):
        yield "of other versions", replace(query, wanted=free)
    yield "of other versions, on other Pythons, whatever passed", Query(wanted=free)


def _version(text: Any) -> str | None:
    try:
        return str(Version(str(text)))
    except InvalidVersion:
        return None

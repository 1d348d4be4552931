"""Find the measured cells that a question is about, in the document made by `digest`.

A package counts for a cell only if a case ran it. A package that only lies in the lock proves nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from harness.model import Outcome, Phase, Verdict
from harness.model.measured import Measured, MeasuredCell
from harness.model.report_types import CaseEntry
from harness.model.vocabulary import parsed_requirement, required_name
from harness.standalone.keys import MODULES, SIMULATORS, weight

HEAVY = 4
"""The least weight of a package that somebody chooses."""

RAN = {
    "interop.sb3.": "stable-baselines3",
    "interop.torchrl.": "torchrl",
    "interop.sb3_contrib.": "sb3-contrib",
    "interop.sb3_contrib.learn": "stable-baselines3",
    "interop.supersuit.": "supersuit",
    "interop.supersuit.sb3_learn": "stable-baselines3",
    "interop.minari.": "minari",
    "interop.tianshou.": "tianshou",
    "interop.skrl.": "skrl",
    "interop.rllib.": "ray",
    "interop.brax.": "brax",
}
"""Checks that run a package which no environment is of, by the beginning of their names."""

OFTEN_HELD = {"setuptools", "importlib-metadata", "pymunk", "cython"}
"""Packages without a simulation whose newer releases broke older ones of others."""

IDLE = {Outcome.SKIPPED, Outcome.NOT_REACHED, Outcome.UNAVAILABLE}
WAYS = "MUJOCO_GL"
"""A variable that is set in many cells as in any script: the other ones are tried for their own sake."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Wanted:
    """A package that was asked for, and its allowed versions."""

    name: str
    versions: SpecifierSet
    text: str

    @classmethod
    def of(cls, text: str) -> Wanted:
        """Parse a requirement; its extras are ignored. Raises ValueError, also for an address or a marker."""
        requirement = parsed_requirement(text)
        if requirement.url or requirement.marker:
            message = (
                f'"{text}" has {"an address" if requirement.url else "a marker"}; name a package, or `name>=version`'
            )
            raise ValueError(message)
        return cls(name=required_name(text), versions=requirement.specifier, text=text)

    def fits(self, version: str | None) -> bool:
        """Return whether a version is allowed."""
        return version is not None and (not self.versions or self.versions.contains(version, prereleases=True))


@dataclass(frozen=True, kw_only=True, slots=True)
class Query:
    """A question: packages, a Python (`3.11` or `3.11.7`), phases that must have passed, an environment."""

    wanted: tuple[Wanted, ...]
    python: str | None = None
    needs: tuple[Phase, ...] = ()
    env: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the packages."""
        return tuple(one.name for one in self.wanted)


class NewestReleases:
    """The newest version of each deciding package in the locks of cells of one Python."""

    def __init__(self, measured: Measured) -> None:
        self._measured = measured
        self._by_minor: dict[str, dict[str, Version]] = {}

    def of(self, minor: str) -> dict[str, Version]:
        """Return the newest versions by package; `minor` is such as `3.11`."""
        if minor not in self._by_minor:
            locks = {one.lock for one in self._measured.cells if (one.python or "").startswith(f"{minor}.")}
            pins = {pin for lock in locks if lock for pin in self._measured.locks[lock] if decides(pin[0])}
            newest: dict[str, Version] = {}
            for name, version in pins:
                newest[name] = max(Version(version), newest.get(name, Version("0")))
            self._by_minor[minor] = newest
        return self._by_minor[minor]


def decides(name: str) -> bool:
    """Return whether the version of a package often decides if something runs."""
    return weight(name) > 0 or name in OFTEN_HELD


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """A measured cell with the versions in its lock; without a lock, the versions that the cell asks for count.

    `parts` are results of one environment that this one joins. `newest` are the releases that other cells have.
    """

    cell: MeasuredCell
    measured: Measured
    newest: NewestReleases
    parts: tuple[CellResult, ...] = ()

    @cached_property
    def pins(self) -> dict[str, str]:
        """Return the versions in the lock; empty without a lock."""
        return dict(self.measured.locks.get(self.cell.lock or "", ()))

    @cached_property
    def versions(self) -> dict[str, str]:
        """Return the versions in the lock, or, if it was not kept, the installed versions that are known."""
        return self.pins or dict(self.cell.installed or {})

    def version(self, name: str) -> str | None:
        """Return the installed version of a package, or the version asked for if nothing could be locked."""
        return self.versions.get(name) or (None if self.pins else self._requested_versions.get(name))

    @cached_property
    def _requested_versions(self) -> dict[str, str]:
        """Return the versions that the cell asks for."""
        versions = {name: version for name, value in self.cell.axes.items() if (version := _version(value))}
        for requirement in self.requirements:
            versions |= {
                canonicalize_name(requirement.name): part.version
                for part in requirement.specifier
                if part.operator == "=="
            }
        return versions

    @cached_property
    def requirements(self) -> tuple[Requirement, ...]:
        """Return the parsed requirements of the cell."""
        return tuple(map(parsed_requirement, self.cell.requirements))

    @cached_property
    def python(self) -> str:
        """Return the Python version, in full if it is known."""
        return str(self.cell.python or self.cell.axes.get("python", ""))

    @property
    def minor(self) -> str:
        """Return the Python version without its last part, such as `3.11`."""
        return ".".join(self.python.split(".")[:2])

    @property
    def works(self) -> bool:
        """Return whether everything that was tried works, with no silent issue left open."""
        # A combination is recommended with its lock, so a result without one is not enough.
        return self.cell.good and bool(self.pins)

    @cached_property
    def named(self) -> frozenset[str]:
        """Return the packages that the matrix asks for by name."""
        axes = (name for name in self.cell.axes if name != "python")
        return frozenset((*axes, *(canonicalize_name(one.name) for one in self.requirements)))

    @property
    def chosen(self) -> dict[str, str]:
        """Return the packages whose version the matrix chose: the version installed, or asked for."""
        return {name: version for name in sorted(self.named) if name != "python" and (version := self.version(name))}

    @cached_property
    def exercised(self) -> frozenset[str]:
        """Return the packages that a case ran, without those that were only installed.

        If the cell noted the packages that it ran, these count; else those that the matrix names and those that the
        cases imported. A package that brings environments of its own counts only if somebody asked for it by name or by
        its API.
        """
        noted = {name for case in self.cell.cases for name in case.exercised or ()}
        noted |= self._ran_by_checks if noted else set()
        spoken = {case.api.replace("_", "-") for case in self.cell.cases}
        imported = {*self.cell.imported}
        ran = noted or self.named | {name for name in self.pins if MODULES.get(name) in imported}
        mine = self.named | spoken
        counted = {name for name in ran | spoken if name in mine or name not in SIMULATORS}
        return frozenset(counted & self.versions.keys())

    @property
    def _ran_by_checks(self) -> set[str]:
        """Return the packages that checks ran, apart from those of the environments."""
        checks = {name for case in self.cell.cases for name, how in case.checks.items() if how not in IDLE}
        return {package for start, package in RAN.items() if any(name.startswith(start) for name in checks)}

    @cached_property
    def held_back(self) -> frozenset[str]:
        """Return the deciding packages that its cases ran in an older release than other cells of the same Python.

        Something kept them back that its requirements do not show, such as a constraint of the matrix.
        """
        newest = self.newest.of(self.minor)
        mine = {name for name in self.exercised if name in newest and name in self.pins}
        return frozenset(name for name in mine if Version(self.pins[name]) < newest[name])

    @property
    def varied(self) -> set[str]:
        """Return the packages that the matrix varies and that the cell is therefore about."""
        light = (name for name in self.cell.axes if not weight(name) or is_heavy(name))
        return {name for name in light if name != "python" and self.version(name)}

    @cached_property
    def subjects(self) -> frozenset[str]:
        """Return the packages that the cell is about: those that its matrix varies, and others that it names and ran.

        Packages that only come with others, such as NumPy, are left out. Where none is left, those that it ran and
        that nothing is known of count.
        """
        ran = self.exercised or self.named
        named = [name for name in self.named if self.version(name)]
        chosen = self.varied | {name for name in named if is_heavy(name) and name in ran}
        return frozenset(chosen or {name for name in named if name in ran and not weight(name)})

    @cached_property
    def counted_versions(self) -> dict[str, str]:
        """Return the versions of the packages that decide how the cell ends: its subjects, and what they stand on."""
        # What a cell would have run, had it come so far, is not known: then all that was installed counts.
        names = self.subjects | {name for name in self.exercised or self.pins if weight(name)}
        return {name: held for name in sorted(names) if (held := self.version(name))}

    @property
    def reason(self) -> str | None:
        """Return the reason that the matrix gives for the result that it expects."""
        return self.cell.expectation.reason if self.cell.expectation else None

    @property
    def own(self) -> bool:
        """Return whether a matrix brought all environments of the cell (`gym:module:function`) itself."""
        return all((case.env or "").count(":") > 1 for case in self.cell.cases) and bool(self.cell.cases)

    @cached_property
    def about(self) -> frozenset[str]:
        """Return the packages that a red cell says something about: those it names or ran."""
        return self.named | self.exercised

    @property
    def variables(self) -> dict[str, str]:
        """Return the environment variables that are set for their own sake: all but `MUJOCO_GL`."""
        return {name: value for name, value in self.cell.environment.items() if name != WAYS}


def is_heavy(name: str) -> bool:
    """Return whether somebody chooses a package for its own sake; lighter ones come with it."""
    return name in SIMULATORS or weight(name) >= HEAVY


def read(measured: Measured) -> list[CellResult]:
    """Return the cells of a document, each with the versions in its lock."""
    newest = NewestReleases(measured)
    return [CellResult(cell=cell, measured=measured, newest=newest) for cell in measured.cells]


# --- what fits -------------------------------------------------------------------------------------------------


def find_fitting(cells: Iterable[CellResult], query: Query) -> list[CellResult]:
    """Return the cells that are about everything asked for, whatever their verdict."""
    return [
        one
        for one in cells
        if all(wanted.fits(one.version(wanted.name)) and wanted.name in one.about for wanted in query.wanted)
        # The dots keep 3.1 from standing for 3.11.
        if query.python is None or f"{one.python}.".startswith(f"{query.python}.")
        if query.env is None or any(names_env(case, query.env) for case in one.cell.cases)
    ]


def find_good(cells: Iterable[CellResult], query: Query) -> list[CellResult]:
    """Return the fitting cells that ran every package asked for, work, and passed the needed phases."""
    return [one for one in find_fitting(cells, query) if one.pins and _answers(one, query)]


def _answers(result: CellResult, query: Query) -> bool:
    return ran(result, query) and works(result, query) and passes(result, query)


def ran(result: CellResult, query: Query) -> bool:
    """Return whether a case ran each package that was asked for."""
    return all(name in result.exercised for name in query.names)


def works(result: CellResult, query: Query) -> bool:
    """Return whether a cell is plainly good.

    For a question about one environment, it is enough that this environment works.
    """
    good = result.works
    if query.env is None or good or result.cell.verdict is not Verdict.PARTIAL:
        return good
    cases = [case for case in result.cell.cases if names_env(case, query.env)]
    return all(case_works(case) for case in cases) and not result.cell.doubts


def some_work(result: CellResult) -> bool:
    """Return whether some environment of a cell works."""
    return any(map(case_works, result.cell.cases))


def case_works(case: CaseEntry) -> bool:
    """Return whether one environment of a cell was run, and everything tried with it passed."""
    fine = {Outcome.PASSED, Outcome.SKIPPED, Outcome.UNAVAILABLE}
    single = case.phases.get(Phase.SINGLE) is Outcome.PASSED
    return single and {*case.phases.values()} <= fine and not case.misleads and not case.unverified


def names_env(case: CaseEntry, env: str) -> bool:
    """Return whether a case uses an environment, given by its id with or without its namespace."""
    return env == case.env or env == (case.env or "").partition(":")[2]


def passes(result: CellResult, query: Query) -> bool:
    """Return whether all needed phases passed, in the environment asked for if there is one."""
    cases = [case.phases for case in result.cell.cases if query.env and names_env(case, query.env)]
    return all(phases.get(phase) is Outcome.PASSED for phases in cases or [result.cell.phases] for phase in query.needs)


def _version(text: Any) -> str | None:
    try:
        return str(Version(str(text)))
    except InvalidVersion:
        return None

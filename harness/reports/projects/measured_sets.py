"""Find the measured cells that concern a project: what was measured of the packages that it holds together."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from packaging.utils import canonicalize_name
from packaging.version import Version

from harness.model import Verdict
from harness.model.measured import MeasuredCell
from harness.model.report_types import CaseEntry
from harness.reports.answers.measured_cells import CellResult, case_works, is_heavy
from harness.reports.projects.project import Project
from harness.standalone.explain.import_names import package_with
from harness.standalone.keys import weight
from harness.standalone.versions import is_version, version

NO_MODULE = re.compile(r"No module named '([\w.]+)'|\b(\w+) is not installed")

ABSENT = "none"
"""The version of a package that is not there."""

NUMPY = "numpy"
NUMPY_MINORS = 2
"""NumPy removed names in minor releases before this major one."""


@dataclass(frozen=True, kw_only=True)
class MeasuredSet:
    """Packages of a project that were measured together, with every cell that ran just these of it."""

    names: tuple[str, ...]
    cells: tuple[CellResult, ...]


@dataclass(frozen=True, kw_only=True)
class Task:
    """An environment of a cell: whether it works there, and if not, why."""

    env: str
    works: bool
    line: str | None
    result: CellResult


def find_sets(cells: Iterable[CellResult], project: Project) -> list[MeasuredSet]:
    """Return the sets of the project's packages that were measured together, the largest first.

    A set within another one is left out, unless the larger one was measured with other versions only. So is a set that
    was measured with other versions only, none of which works.
    """
    groups: dict[frozenset[str], list[CellResult]] = {}
    own = project.packages.keys() - project.conflicts.keys()
    for result in cells:
        if result.varied <= own and is_plain(result) and result.subjects and result.subjects <= own:
            groups.setdefault(result.subjects, []).append(result)
    held = [names for names in groups if any(fits(each, project) for each in groups[names])]
    telling = [names for names in groups if names in held or any(each.works for each in groups[names])]
    shown = [names for names in telling if not any(names < other for other in held)]
    largest = [names for names in shown if names in held or not any(names < other for other in telling)]
    ordered = sorted(largest, key=lambda names: (-len(names), sorted(names)))
    return [
        MeasuredSet(
            names=tuple(sorted(names, key=lambda name: (-weight(name), name))),
            cells=tuple(each for group in groups if names <= group for each in groups[group]),
        )
        for names in ordered
    ]


def is_plain(result: CellResult) -> bool:
    """Return whether a cell shows what a user gets: with wheels of the index, and no variable set for its own sake."""
    cell = result.cell
    return not (result.variables or result.own or cell.brought or cell.repairs or cell.base or cell.subject)


def fits(result: CellResult, project: Project, *, any_python: bool = False) -> bool:
    """Return whether a project admits the versions of a cell.

    A light package that the project pins may have another release of the same first number in the cell.
    """
    if not any_python and not project.admits_python(result.python):
        return False
    if _missing(result) in project.packages or _installs_elsewhere(result, project) or _lacks_numpy(result, project):
        return False
    return not any(_differs(name, held, project, result) for name, held in result.counted_versions.items())


def _installs_elsewhere(result: CellResult, project: Project) -> bool:
    """Return whether a cell could not be installed in a way that says nothing of a project.

    An environment at hand is installed; and a file asks for nothing that an extra would bring which it does not name.
    """
    if result.cell.verdict not in {Verdict.UNRESOLVABLE, Verdict.UNINSTALLABLE}:
        return False
    if project.interpreter is not None:
        return True
    extras = {(canonicalize_name(each.name), extra) for each in result.requirements for extra in each.extras}
    return any(canonicalize_name(extra) not in _extras(project, name) for name, extra in extras)


def _extras(project: Project, name: str) -> frozenset[str]:
    declared = project.packages.get(name)
    return declared.extras if declared else frozenset()


def _lacks_numpy(result: CellResult, project: Project) -> bool:
    """Return whether a project pins NumPy, and it is not known which one a cell had that works."""
    numpy = project.packages.get(NUMPY)
    return bool(result.cell.good and numpy and numpy.pinned and result.version(NUMPY) is None)


def _missing(result: CellResult) -> str | None:
    """Return the package that a cell failed for want of."""
    match = NO_MODULE.search(result.cell.decisive or "")
    name = next(filter(None, match.groups())) if match else ""
    return package_with(name) or package_with(name.lower())


def _differs(name: str, held: str, project: Project, result: CellResult) -> bool:
    public = held.partition("+")[0]
    if project.admits(name, public):
        return False
    pinned = project.packages[name].pinned
    return not (
        not is_heavy(name) and pinned and is_version(pinned) and generation(name, pinned) == generation(name, public)
    )


def generation(name: str, text: str) -> tuple[int, ...]:
    """Return the numbers of a version within which a light package seldom breaks others."""
    numbers: tuple[int, ...] = version(text).release
    fine = name == NUMPY and numbers[0] < NUMPY_MINORS
    return numbers[:2] if fine else numbers[:1]


def differences(result: CellResult, project: Project) -> dict[str, tuple[str, str]]:
    """Return the packages that a cell ran in another version than the pinned one, or that a project lacks.

    Each has the version of the project, or `ABSENT`, and that of the cell.
    """
    apart: dict[str, tuple[str, str]] = {}
    for name in sorted(result.exercised | result.counted_versions.keys()):
        declared, held = project.packages.get(name), str(result.version(name) or "").partition("+")[0]
        if declared is None:
            # What nobody chooses is brought by what is there.
            apart |= {name: (ABSENT, held)} if weight(name) else {}
        elif declared.pinned and weight(name) and not project.admits(name, held):
            apart[name] = declared.pinned, held
    return apart


# --- tasks -----------------------------------------------------------------------------------------------------


def tasks(results: Iterable[CellResult], project: Project, env: str | None = None) -> dict[str, Task]:
    """Return the environments of cells, each as the cell nearest to the project has it.

    Of cells that are equally near, one counts in which it works, then the newest.
    """
    tried: dict[str, list[tuple[tuple[object, ...], Task]]] = {}
    for result in results:
        near = -len(differences(result, project))
        for case in result.cell.cases:
            if case.env is None or (env is not None and bare(case.env, case.api) != bare(env, case.api)):
                continue
            name = bare(case.env, case.api)
            task = Task(env=name, works=case_works(case), line=why(case, result.cell), result=result)
            order = near, task.works, Version(result.python), result.cell.measured
            tried.setdefault(name, []).append((order, task))
    return {name: max(each, key=lambda item: item[0])[1] for name, each in tried.items()}


def bare(env: str, api: str) -> str:
    """Return the id of an environment without the name of its API."""
    return env.removeprefix(f"{api}:")


def why(case: CaseEntry, cell: MeasuredCell) -> str | None:
    """Return the line that says why an environment of a cell does not work."""
    if case.decisive:
        return case.decisive
    if case.misleads:
        return f"it misleads without an error: {', '.join(case.misleads)}"
    doubts = [name.removeprefix("silent:") for name in case.unverified or cell.doubts]
    return f"a known issue without an error is not excluded: {', '.join(doubts)}" if doubts else cell.decisive


# --- nearness --------------------------------------------------------------------------------------------------


def nearest(results: Sequence[CellResult], project: Project, wanted: Sequence[str]) -> CellResult | None:
    """Return the working cell whose versions are nearest to those that the project pins or admits."""
    good = [each for each in results if each.works]
    return min(good, key=lambda each: _distance(each, project, wanted), default=None)


def _distance(result: CellResult, project: Project, wanted: Sequence[str]) -> tuple[object, ...]:
    apart = sum(_gap(str(result.version(name)), project.packages[name].pinned, name, project) for name in wanted)
    light = sum(
        _differs(name, held, project, result) for name, held in result.counted_versions.items() if name not in wanted
    )
    other_python = not project.admits_python(result.python)
    newest = tuple(tuple(-part for part in version(str(result.version(name))).release) for name in wanted)
    return apart + 2 * other_python + light, newest, result.cell.id


def _gap(held: str, pinned: str | None, name: str, project: Project) -> float:
    """Return how far a version is from what a project wants: 0 for an admitted one."""
    public = held.partition("+")[0]
    if project.admits(name, public):
        return 0.0
    if pinned is None or not is_version(pinned):
        return 3.0
    here, there = version(pinned).release, version(public).release
    width = max(len(here), len(there), 3)
    first, second = (tuple(numbers) + (0,) * (width - len(numbers)) for numbers in (here, there))
    scales = (20.0, 1.0, 0.05)
    return sum(scale * abs(one - other) for scale, one, other in zip(scales, first, second, strict=False))

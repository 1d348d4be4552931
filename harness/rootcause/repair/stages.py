"""Define the stages of a repair, the least intrusive first. Each stage yields its changes one by one, on demand."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

from msgspec.structs import replace
from packaging.version import Version

from harness.machine import interpreters, this_machine
from harness.machine.store import cache_folder
from harness.model import Cell, Change, Interpreter, Phase
from harness.model.vocabulary import parsed_requirement, required_name
from harness.packages.environments import site_packages
from harness.reports.answers import result_index
from harness.rootcause.bench import Trial
from harness.rootcause.repair import candidate_changes, failure_hints, times
from harness.rootcause.repair.candidate_changes import Move, Way
from harness.rootcause.repair.lab import Lab
from harness.rootcause.repair.narrowing import Suspect
from harness.running.signatures import shipped_signatures
from harness.standalone.failures.matching import Diagnosis
from harness.standalone.failures.silent import silent_ids

TOOLS = ("setuptools", "wheel", "cython", "numpy", "packaging", "setuptools-scm", "pybind11", "cmake",
         "scikit-build", "scikit-build-core", "meson-python", "poetry-core", "hatchling", "flit-core")  # fmt: skip
"""What sdists are built with."""

HEAVY = ("numpy", "scipy", "pandas", "matplotlib", "pillow", "opencv-python", "opencv-python-headless", "h5py", "torch",
         "torchvision", "pygame", "mujoco", "pybullet", "shapely", "scikit-learn", "scikit-image", "numba", "llvmlite",
         "pyarrow", "grpcio", "lxml", "jaxlib", "tensorflow", "labmaze", "dm-tree", "contourpy", "kiwisolver",
         "cryptography", "cffi", "psutil", "ray", "open3d", "usd-core", "vtk", "pyzmq", "protobuf")  # fmt: skip
"""What is never built here for the sake of a search: it takes long, and users have the wheels."""

NEAREST = 2
"""Locks that work and are tried, those that differ least."""

OLDER = 2
"""Older Pythons that are tried with the index of their time."""

BOTH = (Phase.RESOLVE, Phase.INSTALL)


@dataclass(frozen=True, kw_only=True, slots=True)
class Place:
    """A state of a search: the change made so far, the trial with it, and the phase that failed."""

    lab: Lab
    change: Change
    trial: Trial
    phase: Phase

    @property
    def python(self) -> Interpreter | None:
        """Return the interpreter of the cell; None if this machine does not have it."""
        return interpreters.find(self.trial.cell.python)


Stage = Callable[[Place], Iterator[Move]]


def add_guard(place: Place, move: Move) -> Change:
    """Return the change of a move; if the move has a guard, big packages are not built from source."""
    if not move.guard:
        return move.change
    heavy = tuple(name for name in HEAVY if name not in candidate_changes.asked_for(place.lab.base))
    return candidate_changes.merge_changes(move.change, Change(only_binary=heavy))


def remove_guard(change: Change, own: Collection[str] = ()) -> Change:
    """Return the change without the guard against builds, except for packages in `own`, which a remedy names itself."""
    gone = {*HEAVY} - {*own}
    return replace(change, only_binary=tuple(name for name in change.only_binary if name not in gone))


def named_bounds(place: Place) -> Iterator[Move]:
    """Yield the bounds that the failure names, beside what the user asked for or (`REFUSED`) in its place."""
    cell, pinned = place.trial.cell, candidate_changes.pins(place.trial.cell)
    had = place.trial.versions | pinned
    for name, bound in failure_hints.find_unmet_bounds(place.trial.reasons, had).items():
        line = f"{name}{failure_hints.format_bound(bound)}"
        why = f"the error names {line}"
        if name not in pinned:
            change, contrary = candidate_changes.merge_with_bounds(cell, Change(constraints=(line,)))
            yield Move(change=change, way=Way.REFUSED if contrary else Way.NAMED, why=why)
            continue
        fitting = [each for each in _usable(place, name) if bound.contains(str(each))]
        newer = [each for each in fitting if each > Version(pinned[name])]
        if newer:  # the nearest to what is asked for; the newest may be too new again
            change = candidate_changes.change_release(cell, name, f"=={newer[0]}")
            yield Move(change=change, way=Way.REFUSED, why=why)
        yield Move(
            change=candidate_changes.change_release(cell, name, failure_hints.format_bound(bound)),
            way=Way.REFUSED,
            why=why,
        )


def signature_remedies(place: Place) -> Iterator[Move]:
    """Yield remedies of the known failures that keep what the user asked for."""
    # A working cell may leave silent issues open.
    silent = silent_ids(place.trial.assessed.unverified)
    diagnoses = place.trial.assessed.diagnoses or tuple(
        Diagnosis(signature=one, phase=None, seen="", is_reason=False)
        for one in shipped_signatures.load_all()
        if one.id in silent
    )
    remedies = candidate_changes.propose_remedies(place.trial.cell, diagnoses)
    yield from (one for one in remedies if one.way is Way.SIGNATURE)


def missing_packages(place: Place) -> Iterator[Move]:
    """Yield the installs that an error suggests, and packages whose modules were not found."""
    # A module that a build misses is missing in the isolated environment of that build; a requirement is no help.
    if place.phase in BOTH:
        return
    cell, evidence = place.trial.cell, place.trial.assessed.failures
    for change in failure_hints.find_suggested_installs(cell, evidence):
        yield Move(change=change, way=Way.MISSING, why="what the error says to install")
    installed = place.trial.record.installed or {}
    for module in failure_hints.missing_modules(evidence):
        for requirement in failure_hints.providers(module, _declared(place, module)):
            change = failure_hints.add_requirement(cell, requirement)
            if not (requirement in installed and change.requirements):
                yield Move(change=change, way=Way.MISSING, why=f"{module} is imported, and nothing requires it")


def _declared(place: Place, module: str) -> tuple[str, ...]:
    """Return a module's name as a package if an installed package declares it, if only in an extra."""
    name = module.replace("_", "-").lower()
    folder = cache_folder() / "environments" / (place.trial.record.key or "none")
    return (name,) if folder.is_dir() and site_packages.requiring(folder, name) else ()


def overlay(place: Place) -> Iterator[Move]:
    """Yield repaired releases of packages that do not resolve or install."""
    if place.phase not in BOTH:
        return
    packages = {*candidate_changes.asked_for(place.lab.base), *place.trial.versions}
    text = "\n".join(text for one in place.trial.assessed.failures for text in (*one.reasons, *one.logs))
    for name in place.lab.recipes:
        if name in packages or re.search(rf"\b{re.escape(name)}\b", text):
            yield Move(
                change=Change(overlay=(name,)), way=Way.OVERLAY, why=f"a release of {name} as it is repaired here"
            )


def builds(place: Place) -> Iterator[Move]:
    """Yield build requirements as they were when the newest pinned release was uploaded."""
    if place.phase is not Phase.INSTALL:
        return
    offline = place.lab.settings.offline
    for instant in _instants(place)[-1:]:
        tool_versions = ((tool, times.newest(place.trial.cell, tool, instant, offline=offline)) for tool in TOOLS)
        lines = tuple(f"{tool}<={version}" for tool, version in tool_versions if version)
        if lines:
            why = f"built with what there was on {instant[:10]}"
            yield Move(change=Change(build_constraints=lines), way=Way.BUILDS, why=why, guard=True)


def tools(cell: Cell, change: Change, *, offline: bool) -> Iterator[Suspect]:
    """Yield the build tools that differ between now and the time or bounds of a change."""
    bounds = {required_name(line): parsed_requirement(line).specifier for line in change.build_constraints}
    for tool in TOOLS:
        now = times.newest(cell, tool, cell.question.snapshot, offline=offline)
        then = (
            times.newest(cell, tool, change.as_of, offline=offline, within=bounds.get(tool))
            if change.as_of or tool in bounds
            else None
        )
        if now and then and now != then:
            yield Suspect(name=tool, good=then, bad=now, build=True)


def date(place: Place) -> Iterator[Move]:
    """Yield the whole index as it stood when the newest pinned release was uploaded, and a little later."""
    if place.change.as_of:
        return
    for instant in _instants(place):
        change = Change(as_of=instant)
        yield Move(change=change, way=Way.DATE, why=f"resolved as of {instant[:10]}", guard=True)
        if _no_other(place):
            return  # it is not what came later


def _no_other(place: Place) -> bool:
    """Return whether the cell that was measured last fails in exactly the same way."""
    last_failure, before = place.lab.runs[-1].trial.failure, place.trial.failure
    return last_failure is not None and before is not None and last_failure.same(before)


def _instants(place: Place, minor: str | None = None) -> tuple[str, ...]:
    """Return the times worth a try, on the Python of the cell or on another one."""
    minor = minor or (place.python.minor if place.python else place.trial.cell.python)
    had = place.trial.versions
    return times.instants(place.trial.cell, had, minor, offline=place.lab.settings.offline)


def lock(place: Place) -> Iterator[Move]:
    """Yield the versions of cells that work: the same cases, on the same Python, with what the user pins."""
    minor, pinned = place.python.minor if place.python else "", candidate_changes.pins(place.trial.cell)
    bad = place.trial.versions
    cases = {(case.env, case.api) for case in place.trial.cell.cases if case.env}
    results = result_index.load()
    changes_by_lock: dict[str, Change] = {}
    for cell in results.cells:
        if cell.lock is None or not cell.good:
            continue
        if not (cases and cases <= {(case.env, case.api) for case in cell.cases}):
            continue
        had = dict(results.locks[cell.lock])
        if cell.id == place.lab.base.id or not (cell.python or "").startswith(f"{minor}."):
            continue
        if all(had.get(name) == version for name, version in pinned.items()):
            lines = [f"{name}=={version}" for name, version in had.items() if bad.get(name, version) != version]
            changes_by_lock.setdefault(cell.lock, Change(constraints=tuple(lines)))
    nearest = sorted(
        (one for one in changes_by_lock.values() if one.constraints), key=lambda candidate: len(candidate.constraints)
    )
    for change in nearest[:NEAREST]:
        yield Move(change=change, way=Way.LOCK, why="the versions of a cell that works", guard=True)


def wheels(place: Place) -> Iterator[Move]:
    """Yield changes that build nothing from source: another release may have wheels."""
    if place.phase is not Phase.INSTALL:
        return
    text = "\n".join(place.trial.reasons)
    names = [name for name in place.trial.versions if re.search(rf"\b{re.escape(name)}\b", text)]
    for name in names:
        yield Move(change=Change(only_binary=(name,)), way=Way.WHEELS, why=f"no build of {name}")
    yield Move(change=Change(only_binary=(":all:",)), way=Way.WHEELS, why="no build at all")


def variables(place: Place) -> Iterator[Move]:
    """Yield ways to render, and a display."""
    here = frozenset(this_machine.facts().capabilities)
    evidence, installed = place.trial.assessed.failures, place.trial.record.installed
    yield from failure_hints.variables(place.trial.cell, place.phase, evidence, here=here, installed=installed)


def python(place: Place) -> Iterator[Move]:
    """Yield the other Pythons of this machine, the nearest first."""
    now = place.python
    if place.change.python or (place.trial.cell.python == "host" and now is None):
        return
    here = _minor(now.minor if now else place.trial.cell.python)
    pythons = {one.minor: one for one in interpreters.available() if one.implementation == "cpython"}
    others = [minor for minor in pythons if _minor(minor) != here]
    for minor in sorted(others, key=lambda each: (abs(_minor(each) - here), _minor(each) > here)):
        yield Move(change=Change(python=minor), way=Way.PYTHON, why=f"on Python {minor}", guard=True)
        if place.phase not in BOTH and _no_other(place):
            break  # it is not the Python
    yield from _of_the_time(place, [minor for minor in others if _minor(minor) < here])


def _of_the_time(place: Place, older: Collection[str]) -> Iterator[Move]:
    """Yield the index of the time on older Pythons, if it had nothing that installs on this one."""
    plain = remove_guard(place.change)
    dated = [
        one for one in place.lab.runs if one.change.as_of and remove_guard(replace(one.change, as_of=None)) == plain
    ]
    failed = {one.trial.failure.phase if one.trial.failure else None for one in dated}
    if place.change.as_of or not dated or not failed <= {*BOTH}:
        return
    for minor in sorted(older, key=_minor, reverse=True)[:OLDER]:
        for instant in _instants(place, minor)[-1:]:
            why = f"on Python {minor}, resolved as of {instant[:10]}"
            yield Move(change=Change(python=minor, as_of=instant), way=Way.PYTHON, why=why, guard=True)


def _minor(text: str) -> int:
    parts = text.split(".")
    return int(parts[1]) if len(parts) > 1 and parts[1].isdigit() else 0


def pins(place: Place) -> Iterator[Move]:
    """Yield other releases of what the user pins: those that a remedy names, then those ever farther away."""
    yield from (
        one
        for one in candidate_changes.propose_remedies(place.trial.cell, place.trial.assessed.diagnoses)
        if one.way is Way.PINS
    )
    pinned = candidate_changes.pins(place.lab.base)
    for name in failure_hints.suspects(pinned, place.trial.assessed.failures):
        for version in _around(place, name, Version(pinned[name])):
            change = candidate_changes.change_release(place.lab.base, name, f"=={version}")
            yield Move(change=change, way=Way.PINS, why=f"with {name} {version}", guard=True)


def _around(place: Place, name: str, now: Version) -> Iterator[Version]:
    """Yield releases at doubling distance, newer and older in turn."""
    releases = _usable(place, name)
    newer = [each for each in releases if each > now]
    older = [each for each in reversed(releases) if each < now]
    step = 1
    while step <= max(len(newer), len(older)):
        yield from (line[step - 1] for line in (newer, older) if step <= len(line))
        step *= 2
    yield from (line[-1] for line in (newer, older) if line)


def _usable(place: Place, name: str) -> tuple[Version, ...]:
    offline = place.lab.settings.offline
    return times.usable(place.trial.cell, name, place.python, wheels=name in HEAVY, offline=offline)


# `Way.DISPLAY` has no stage of its own: `variables` yields its moves, too.
STAGES: dict[Way, Stage] = {
    Way.NAMED: lambda place: (one for one in named_bounds(place) if one.way is Way.NAMED),
    Way.SIGNATURE: signature_remedies,
    Way.MISSING: missing_packages,
    Way.OVERLAY: overlay,
    Way.BUILDS: builds,
    Way.REFUSED: lambda place: (one for one in named_bounds(place) if one.way is Way.REFUSED),
    Way.DATE: date,
    Way.LOCK: lock,
    Way.WHEELS: wheels,
    Way.VARIABLE: variables,
    Way.PYTHON: python,
    Way.PINS: pins,
}

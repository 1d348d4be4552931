"""Foresee an upgrade of a project from measured results: would it install, run, behave and look the same."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from harness.model import replace
from harness.model.measured import Measured, ReleaseSeries
from harness.model.vocabulary import parsed_requirement
from harness.reports.answers import measured_cells
from harness.reports.answers.measured_cells import CellResult, is_heavy
from harness.reports.projects import changes, installable, measured_sets
from harness.reports.projects.changes import TaskChange
from harness.reports.projects.installable import InstallAnswer, Requirements
from harness.reports.projects.measured_sets import Task, bare
from harness.reports.projects.project import Declared, Project, with_versions
from harness.reports.projects.upgrade_document import Move, RunningTask, Sameness, Upgraded
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.versions import is_version, specifiers, version


def upgrade(
    measured: Measured, project: Project, moves: Sequence[Move], command: Sequence[str], env: str | None
) -> Upgraded:
    """Return everything that is known of an upgrade; `env` limits it to one environment."""
    cells = measured_cells.read(measured)
    targets = {move.name: move.then for move in moves}
    requirements = installable.Requirements(project)
    install = requirements.answer(with_versions(project, targets), targets)
    asked_for, moves = moves, [*moves, *_pulled(install, project, measured)]
    targets = {move.name: move.then for move in moves}
    after = with_versions(project, targets)
    running, concerned = _running(cells, project, after, targets, env)
    kinds = [
        [each for each in changes.concerning(measured.series, after, pictures=pictures) if env in {None, _name(each)}]
        for pictures in (False, True)
    ]
    behaviour, pictures = (_sameness(series, after, moves, concerned) for series in kinds)
    unchanging = _Unchanging(project, cells, kinds, requirements)
    return Upgraded(
        source=project.source,
        python=project.python,
        moves=tuple(moves),
        install=install,
        tasks=tuple(sorted(concerned)),
        running=tuple(running),
        behaviour=behaviour,
        pictures=pictures,
        unchanging={move.name: unchanging.newest(move, env) for move in asked_for},
        command=tuple(command),
    )


# --- the release -----------------------------------------------------------------------------------------------


def target(text: str, project: Project, measured: Measured) -> Move:
    """Return the move that a requirement asks for: to the newest release that it admits. Raises ValueError."""
    wanted = parsed_requirement(text)
    name = measured_cells.Wanted.of(text).name
    now = project.packages.get(name)
    admits = specifiers(str(wanted.specifier))
    releases = [release for release in _releases(name, project, measured) if admits.admits(release)]
    pins = [clause.version for clause in admits.clauses if clause.operator == "==" and not clause.version.endswith("*")]
    if not releases and not pins:
        message = f"{text}: no release of {name} is known that it admits; name one, such as {name}==1.2.3"
        raise ValueError(message)
    then = max(releases, key=version) if releases else pins[0]
    return Move(name=name, now=_now(now, name, measured, project), then=then)


def _pulled(install: InstallAnswer, project: Project, measured: Measured) -> Iterator[Move]:
    """Yield the packages that have to move, too, each to the newest release that fits: so a resolver does."""
    for name, versions in install.pulled.items():
        admits = specifiers(versions).admits
        releases = [release for release in _releases(name, project, measured) if admits(release)]
        if releases:
            yield Move(name=name, now=project.packages[name].pinned, then=max(releases, key=version), pulled=True)


def _now(declared: Declared | None, name: str, measured: Measured, project: Project) -> str | None:
    """Return the version at hand: the pinned one, else the newest that a project admits."""
    if declared is None or declared.pinned:
        return declared.pinned if declared else None
    admitted = [release for release in _releases(name, project, measured) if declared.versions.admits(release)]
    return max(admitted, key=version, default=None)


def _releases(name: str, project: Project, measured: Measured) -> list[str]:
    """Return the known releases of a package that are for the project's Python, prereleases left out."""
    history = load_shipped(name)
    if history is None:
        held = {
            str(each.version(name)).partition("+")[0] for each in measured_cells.read(measured) if each.version(name)
        }
        return [release for release in held if is_version(release) and not version(release).is_prerelease]
    python = ".".join(project.python.split(".")[:2]) + ".99" if project.python else None
    return [
        entry["version"]
        for entry in history.plain["releases"]
        if not entry.get("yanked")
        and not version(entry["version"]).is_prerelease
        and (python is None or specifiers(str(entry.get("python") or "")).admits(python))
    ]


# --- would it run ----------------------------------------------------------------------------------------------


def _running(
    cells: Sequence[CellResult], before: Project, after: Project, targets: Mapping[str, str], env: str | None
) -> tuple[list[RunningTask], set[str]]:
    """Return the environments that were run with the targets, and all of a project that use a target.

    These are the ones that work now; if nothing was measured as it is now, all that were measured with some release.
    """
    free = replace(
        after,
        packages={**after.packages, **{name: Declared(name=name, versions=specifiers("")) for name in targets}},
    )
    running: list[RunningTask] = []
    now: set[str] = set()
    ever: set[str] = set()
    for each in measured_sets.find_sets(cells, free):
        using = [result for result in each.cells if {*targets} & (result.exercised | result.subjects)]
        tasks = _tasks_with(using, after, targets, env)
        running += tasks
        ever |= _names(using, free, targets, env)
        now |= _names([result for result in using if _at_hand(result, before, targets)], before, targets, env)
    best: dict[str, RunningTask] = {}
    for task in sorted(running, key=lambda task: (len(task.other_versions), task.env, not task.works)):
        best.setdefault(task.env, task)
    concerned = now or ever | best.keys()
    return [task for task in best.values() if task.env in concerned], concerned


def _at_hand(result: CellResult, before: Project, targets: Iterable[str]) -> bool:
    """Return whether a cell has the versions at hand, also of the packages that move."""
    if not all(name in before.packages and before.admits(name, _public(result, name)) for name in targets):
        return False
    return measured_sets.fits(result, before, any_python=True)


def _names(results: Iterable[CellResult], project: Project, targets: Iterable[str], env: str | None) -> set[str]:
    """Return the environments that work in cells that a project admits, and use one of the targets."""
    fitting = [result for result in results if measured_sets.fits(result, project, any_python=True)]
    tasks = (task for result in fitting for task in measured_sets.tasks([result], project, env).values())
    return {task.env for task in tasks if task.works and _uses(task, targets)}


def _tasks_with(
    results: Sequence[CellResult], after: Project, targets: Mapping[str, str], env: str | None
) -> list[RunningTask]:
    """Return the environments that were run with the targets, on the Python of a project where there are any.

    Where one was not run with a release of a light package, another one of its generation may stand for it.
    """
    tasks: dict[str, Task] = {}
    for exactly in (True, False):
        having = [result for result in results if _has_all(result, targets, exactly=exactly)]
        fitting = [result for result in having if measured_sets.fits(result, after)]
        fitting = fitting or [result for result in having if measured_sets.fits(result, after, any_python=True)]
        nearest = measured_sets.tasks(fitting, after, env)
        tasks = {name: task for name, task in nearest.items() if _uses(task, targets)} | tasks
    return [_describe(task, after) for task in tasks.values()]


def _describe(task: Task, after: Project) -> RunningTask:
    return RunningTask(
        env=task.env,
        works=task.works,
        cell=task.result.cell.id,
        python=task.result.python,
        line=None if task.works else task.line,
        other_versions={name: there for name, (_, there) in measured_sets.differences(task.result, after).items()},
    )


def _has_all(result: CellResult, targets: Mapping[str, str], *, exactly: bool) -> bool:
    """Return whether a cell has these releases, or lacks the packages."""
    for name, release in targets.items():
        held = _public(result, name)
        if held in {"", release}:
            continue
        if exactly or is_heavy(name) or measured_sets.generation(name, held) != measured_sets.generation(name, release):
            return False
    return True


def _public(result: CellResult, name: str) -> str:
    """Return the version of a package in a cell without its local part; empty where it is not there."""
    return str(result.version(name) or "").partition("+")[0]


def _uses(task: Task, targets: Iterable[str]) -> bool:
    """Return whether an environment runs a package that moves; where that was not noted, whether its cell names one."""
    cell = task.result.cell
    case = next(case for case in cell.cases if case.env and bare(case.env, case.api) == task.env)
    unnoted = task.result.subjects | task.result.pins.keys()
    return bool({*(case.exercised or unnoted)} & {*targets})


# --- would it be the same --------------------------------------------------------------------------------------


def _name(each: ReleaseSeries) -> str:
    return bare(each.env, each.api)


def _sameness(
    series: Iterable[ReleaseSeries], after: Project, moves: Sequence[Move], concerned: Collection[str]
) -> Sameness:
    """Return which environments stay the same over moves; without any that are `concerned`, of all of the series."""
    same: dict[str, bool] = {}
    changed: list[TaskChange] = []
    starts: set[str] = set()
    undecided: set[str] = set()
    others: dict[str, str] = {}
    now = {move.name: move for move in moves if move.now is not None}
    for each in changes.nearest(series, after):
        name, move = _name(each), now.get(each.package)
        if move is None or move.now is None or (concerned and name not in concerned):
            continue
        answer = changes.alike(each, move.now, move.then)
        steps = changes.steps_within(each, move.now, move.then)
        others |= changes.other_versions(each, after)
        if answer is None:
            undecided.add(name)
        elif answer:
            exact = all(changes.measured_there(each, release) for release in (move.now, move.then))
            same[name] = same.get(name, True) and exact
            lasting = changes.lasting(each, steps)
            starts |= {name for step in steps if step not in lasting}
        else:
            changed += changes.task_changes(each, changes.lasting(each, steps))
    moved = {change.env for change in changed}
    alike = {*same} - moved - undecided
    return Sameness(
        same=tuple(sorted(alike)),
        changed=tuple({(change.env, change.package, change.after): change for change in changed}.values()),
        unmeasured=tuple(sorted({*concerned} - alike - moved)),
        between=tuple(sorted(name for name in alike if not same[name])),
        starts=tuple(sorted(starts - moved)),
        other_versions=others,
    )


@dataclass(frozen=True)
class _Unchanging:
    """Looks for the newest release at which nothing changes; `kinds` are series of behaviour, and of pictures."""

    project: Project
    cells: Sequence[CellResult]
    kinds: Sequence[Sequence[ReleaseSeries]]
    requirements: Requirements

    def newest(self, move: Move, env: str | None) -> str | None:
        """Return the newest release at which all that was measured stays the same and works; None if it is at hand."""
        releases = {
            release
            for each in self.kinds[0]
            if each.package == move.name
            for release in each.releases
            if move.now and is_version(release) and version(release) > version(move.now)
        }
        ordered = sorted(releases, key=version, reverse=True)
        return next((release for release in ordered if self._changes_nothing(move, release, env)), None)

    def _changes_nothing(self, move: Move, release: str, env: str | None) -> bool:
        step = [Move(name=move.name, now=move.now, then=release)]
        after = with_versions(self.project, {move.name: release})
        behaviour, pictures = (_sameness(series, after, step, ()) for series in self.kinds)
        if behaviour.changed or pictures.changed or not behaviour.same:
            return False
        if self.requirements.answer(after, {move.name: release}).possible is False:
            return False
        running, _ = _running(self.cells, self.project, after, {move.name: release}, env)
        return all(task.works for task in running)

"""Foresee an upgrade of a project from measured results: would it install, run, behave and look the same."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import msgspec

from harness.model.measured import Measured, ReleaseSeries
from harness.model.vocabulary import parsed_requirement
from harness.reports.answers import measured_cells
from harness.reports.answers.measured_cells import CellResult
from harness.reports.projects import changes, installable, measured_sets
from harness.reports.projects.changes import TaskChange
from harness.reports.projects.installable import InstallAnswer
from harness.reports.projects.measured_sets import Task, bare
from harness.reports.projects.project import Declared, Project, with_versions
from harness.standalone.explain.api_history import load_shipped
from harness.standalone.versions import is_version, specifiers, version


class Move(msgspec.Struct, frozen=True, kw_only=True):
    """A package that moves: `now` is the version at hand, None if it is not there or not pinned."""

    name: str
    now: str | None
    then: str


class RunningTask(msgspec.Struct, frozen=True, kw_only=True):
    """An environment in the measured combination nearest to the upgrade; `line` says why it does not work."""

    env: str
    works: bool
    cell: str
    python: str
    line: str | None = None
    other_versions: dict[str, str] = {}


class Sameness(msgspec.Struct, frozen=True, kw_only=True):
    """The environments that stay the same, that change, and of which it was not measured.

    `between` are those that stay the same by their neighbours: one of the releases was not measured itself.
    `other_versions` are those of other packages with which it was measured, where they are not those at hand.
    """

    same: tuple[str, ...]
    changed: tuple[TaskChange, ...]
    unmeasured: tuple[str, ...]
    between: tuple[str, ...] = ()
    starts: tuple[str, ...] = ()
    other_versions: dict[str, str] = {}

    @property
    def changing(self) -> list[str]:
        """Return the environments that change."""
        return sorted({change.env for change in self.changed})


class Upgraded(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `upgrade --json`.

    `tasks` are the environments of the project that use a package which moves. `unchanging` is the newest release of
    each package at which nothing is known to change, None where that is the one at hand. `command` does the upgrade.
    """

    schema: int = 1
    source: str
    python: str | None
    moves: tuple[Move, ...]
    install: InstallAnswer
    tasks: tuple[str, ...]
    running: tuple[RunningTask, ...]
    behaviour: Sameness
    pictures: Sameness
    unchanging: dict[str, str | None]
    command: tuple[str, ...]


def upgrade(
    measured: Measured, project: Project, moves: Sequence[Move], command: Sequence[str], env: str | None
) -> Upgraded:
    """Return everything that is known of an upgrade; `env` limits it to one environment."""
    cells = measured_cells.read(measured)
    targets = {move.name: move.then for move in moves}
    after = with_versions(project, targets)
    running, concerned = _running(cells, project, after, targets, env)
    behaviour = _sameness(measured.series, after, moves, concerned, env, pictures=False)
    pictures = _sameness(measured.series, after, moves, concerned, env, pictures=True)
    return Upgraded(
        source=project.source,
        python=project.python,
        moves=tuple(moves),
        install=installable.install_answer(project, after, targets),
        tasks=tuple(sorted(concerned)),
        running=tuple(running),
        behaviour=behaviour,
        pictures=pictures,
        unchanging={move.name: _unchanging(measured, cells, project, move, env) for move in moves},
        command=tuple(command),
    )


def exit_code(document: Upgraded) -> int:
    """Return 1 where something fails or changes, 3 where something was not measured, else 0."""
    fails = document.install.possible is False or any(not task.works for task in document.running)
    if fails or document.behaviour.changed or document.pictures.changed:
        return 1
    measured = {task.env for task in document.running}
    whole = document.tasks and measured >= {*document.tasks} and not document.behaviour.unmeasured
    return 0 if whole and document.install.possible else 3


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
        using = [result for result in each.cells if {*targets} & (result.exercised | measured_sets.chosen(result))]
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
    tasks = measured_sets.tasks(fitting, project, env)
    return {name for name, task in tasks.items() if task.works and _uses(task, targets)}


def _tasks_with(
    results: Sequence[CellResult], after: Project, targets: Mapping[str, str], env: str | None
) -> list[RunningTask]:
    """Return the environments that were run with the targets, on the Python of a project where there are any."""
    having = [result for result in results if all(_public(result, name) in {"", targets[name]} for name in targets)]
    fitting = [result for result in having if measured_sets.fits(result, after)]
    fitting = fitting or [result for result in having if measured_sets.fits(result, after, any_python=True)]
    return [
        RunningTask(
            env=task.env,
            works=task.works,
            cell=task.result.cell.id,
            python=task.result.python,
            line=None if task.works else task.line,
            other_versions={name: there for name, (_, there) in measured_sets.differences(task.result, after).items()},
        )
        for task in measured_sets.tasks(fitting, after, env).values()
        if _uses(task, targets)
    ]


def _public(result: CellResult, name: str) -> str:
    """Return the version of a package in a cell without its local part; empty where it is not there."""
    return str(result.version(name) or "").partition("+")[0]


def _uses(task: Task, targets: Iterable[str]) -> bool:
    """Return whether an environment runs a package that moves; where that was not noted, whether its cell names one."""
    noted = next((case.exercised for case in task.result.cell.cases if task.env in str(case.env)), ())
    ran = {*noted} if noted else {*measured_sets.chosen(task.result)}
    return bool(ran & {*targets})


# --- would it be the same --------------------------------------------------------------------------------------


def _sameness(
    series: Iterable[ReleaseSeries],
    after: Project,
    moves: Sequence[Move],
    concerned: Collection[str],
    env: str | None,
    *,
    pictures: bool,
) -> Sameness:
    same: dict[str, bool] = {}
    changed: list[TaskChange] = []
    starts: set[str] = set()
    undecided: set[str] = set()
    others: dict[str, str] = {}
    concerning = changes.nearest(changes.concerning(series, after, pictures=pictures), after)
    for move in moves:
        for each in concerning:
            name = bare(each.env, each.api)
            if each.package != move.name or move.now is None or env not in {None, name}:
                continue
            if concerned and name not in concerned:
                continue
            answer = changes.alike(each, move.now, move.then)
            steps = changes.steps_within(each, move.now, move.then)
            others |= changes.other_versions(each, after)
            if answer is None:
                undecided.add(name)
            elif answer:
                exact = all(changes.measured_there(each, release) for release in (move.now, move.then))
                same[name] = same.get(name, True) and exact
                starts |= {name for step in steps if step not in changes.lasting(each, steps)}
            else:
                changed += changes.task_changes(each, changes.lasting(each, steps))
    moved = {change.env for change in changed}
    alike = {*same} - moved - undecided
    return Sameness(
        same=tuple(sorted(alike)),
        changed=tuple(dict.fromkeys(changed)),
        unmeasured=tuple(sorted({*concerned} - alike - moved)),
        between=tuple(sorted(name for name in alike if not same[name])),
        starts=tuple(sorted(starts - moved)),
        other_versions=others,
    )


def _unchanging(
    measured: Measured, cells: Sequence[CellResult], project: Project, move: Move, env: str | None
) -> str | None:
    """Return the newest release at which all that was measured stays the same and works; None for the one at hand."""
    if move.now is None:
        return None
    releases = {
        release
        for each in changes.concerning(measured.series, project)
        if each.package == move.name
        for release in each.releases
        if is_version(release) and version(release) > version(move.now)
    }
    for release in sorted(releases, key=version, reverse=True):
        step = [Move(name=move.name, now=move.now, then=release)]
        after = with_versions(project, {move.name: release})
        sames = [_sameness(measured.series, after, step, (), env, pictures=pictures) for pictures in (False, True)]
        running, _ = _running(cells, project, after, {move.name: release}, env)
        installs = installable.install_answer(project, after, {move.name: release}).possible is not False
        if (
            installs
            and sames[0].same
            and not any(each.changed for each in sames)
            and all(task.works for task in running)
        ):
            return release
    return None

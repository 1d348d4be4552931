"""Check a project against measured results: what was measured good or bad of it, and what was never measured."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from harness.model import Verdict, replace
from harness.model.measured import Measured
from harness.model.report_types import first_few
from harness.reports.answers import measured_cells, traps
from harness.reports.answers.measured_cells import CellResult, Query, Wanted
from harness.reports.answers.traps import Red
from harness.reports.projects import changes, measured_sets
from harness.reports.projects.check_document import Checked, CheckFinding, Kind
from harness.reports.projects.measured_sets import MeasuredSet, Task, bare
from harness.reports.projects.project import Declared, Project
from harness.running.signatures import issue_texts
from harness.standalone.versions import is_version, specifiers, version

FEW = 3
LACKING = re.compile(
    r"(\w+\.)*(NameNotFound|NamespaceNotFound|VersionNotFound|DeprecatedEnv|UnregisteredEnv|DependencyNotInstalled)\b"
    r"|.*Unable to find (the )?game"
)
"""Errors of gym and gymnasium for an id that a release has not, and for a package or a ROM of one task alone."""

UPPER = frozenset({"<", "<=", "~=", "!="})
"""Operators by which a project keeps newer releases out; a pin is its own answer."""


def check(measured: Measured, project: Project, env: str | None = None) -> Checked:
    """Return everything that measured results say about a project; `env` limits it to one environment."""
    cells = measured_cells.read(measured)
    sets = measured_sets.find_sets(cells, project)
    findings = [CheckFinding(kind=Kind.CONFLICT, text=text) for text in project.conflicts.values()]
    for each in sets:
        findings += _of_set(each, project, env)
    newest: dict[str, str] = {}
    for finding in findings:
        for name, held in finding.versions.items() if finding.kind is Kind.GOOD else ():
            newest[name] = min(newest.get(name, held), held, key=version)
    findings += _of_behaviour(measured, project, env, newest)
    covered = {name for each in sets for name in each.names}
    ran = {name for each in sets for result in each.cells for name in result.exercised}
    own = [declared for declared in project.packages.values() if declared.by is None]
    return Checked(
        source=project.source,
        python=project.python or str(project.pythons) or None,
        packages=tuple(each.text for each in project.packages.values() if each.name in covered),
        findings=tuple(_with_fixes(sorted(findings, key=lambda finding: [*Kind].index(finding.kind)))),
        not_run=tuple(sorted(each.name for each in own if each.name not in ran | covered)),
        unjudged=project.unjudged,
    )


def _with_fixes(findings: Sequence[CheckFinding]) -> Iterator[CheckFinding]:
    """Yield the findings, each with what helps against its cause."""
    fixes = {issue.id: issue.fix for issue in issue_texts.load()} if any(each.causes for each in findings) else {}
    for finding in findings:
        fix = next((fixes[cause] for cause in finding.causes if cause in fixes), None)
        yield msgspec.structs.replace(finding, fix=fix) if fix else finding


# --- one set of packages ---------------------------------------------------------------------------------------


def _of_set(each: MeasuredSet, project: Project, env: str | None) -> Iterator[CheckFinding]:
    fitting = [result for result in each.cells if measured_sets.fits(result, project)]
    if env is not None:
        fitting = [result for result in fitting if measured_sets.tasks([result], project, env)]
    if not fitting:
        yield _unmeasured(each, project)
        return
    # A line of requirements as somebody typed it may fail by a wrong id, or by a package that this project lacks: what
    # works there counts, what fails does not.
    varied = [result for result in fitting if result.cell.axes.keys() & set(each.names)] or fitting
    good = [result for result in fitting if any(task.works for task in _tasks_of([result], project, env))]
    if _is_closed(project) and all(project.packages[name].pinned for name in each.names):
        tasks = _tasks_of(varied, project, env)
        tried = {task.env for task in tasks}
        tasks += [task for task in _tasks_of(fitting, project, env) if task.works and task.env not in tried]
        works = [task for task in tasks if task.works]
        fails = [task for task in tasks if not task.works]
        yield from [_good(each, works, project)] if works else []
        yield from [_bad(each, fails, varied, len(tasks))] if fails or not works else []
        return
    if good:
        newest = max(_newness(result, each.names) for result in good)
        alike = [result for result in good if _newness(result, each.names) == newest]
        yield _good(each, [task for task in _tasks_of(alike, project, env) if task.works], project)
    broken = [
        trap
        for trap in traps.find_traps(varied, _query(each, project, env))
        if _counts(trap, good) and (env or not _lacks(trap.line))
    ]
    yield from (_admits(each, trap, fitting, project, env) for trap in broken)
    yield from _excludes(each, fitting, project)


def _tasks_of(results: Sequence[CellResult], project: Project, env: str | None) -> list[Task]:
    """Return the environments of cells; one that lacks what it alone needs counts only if it is the one in question."""
    tasks = measured_sets.tasks(results, project, env).values()
    return [task for task in tasks if task.works or env or not _lacks(task.line)]


def _lacks(line: str | None) -> bool:
    """Return whether a task fails for want of what it alone needs, which says nothing of the versions at hand."""
    return bool(LACKING.match(line or ""))


def _is_closed(project: Project) -> bool:
    """Return whether a project leaves a resolver no choice of NumPy, on which all else stands."""
    numpy = project.packages.get("numpy")
    return numpy is not None and numpy.pinned is not None


def _counts(trap: Red, good: Sequence[CellResult]) -> bool:
    """Return whether a project can run into a trap: a resolver steps around what it cannot resolve, where it can."""
    return not good or trap.verdicts != (Verdict.UNRESOLVABLE,)


def _good(each: MeasuredSet, works: Sequence[Task], project: Project) -> CheckFinding:
    best = works[0].result
    text = f"{_versions(best, each.names)} run {_tasks(works)}{_apart(best, project)}"
    return CheckFinding(
        kind=Kind.GOOD,
        text=text,
        versions=_held(best, each.names),
        python=best.python,
        measured=best.cell.measured,
        cells=tuple(dict.fromkeys(task.result.cell.id for task in works)),
    )


def _apart(result: CellResult, project: Project) -> str:
    """Return the versions of a cell that are not those of a project."""
    apart = measured_sets.differences(result, project)
    there = ", ".join(f"{name} {measured} (here {own})" for name, (own, measured) in sorted(apart.items()))
    return f"; measured with {there}" if there else ""


def _bad(each: MeasuredSet, fails: Sequence[Task], fitting: Sequence[CellResult], count: int) -> CheckFinding:
    result = fails[0].result if fails else fitting[0]
    line = next((task.line for task in fails if task.line), result.cell.decisive)
    of = f"{len(fails)} of {count} tasks fail: {_names(fails)}" if fails else f"it {word(result)}"
    return CheckFinding(
        kind=Kind.BAD,
        text=f"{_versions(result, each.names)}: {of}",
        versions=_held(result, each.names),
        python=result.python,
        measured=result.cell.measured,
        line=line,
        cells=tuple(dict.fromkeys(task.result.cell.id for task in fails)) or (result.cell.id,),
        causes=result.cell.causes,
        next=f"simmatrix show {result.cell.id}",
    )


def word(result: CellResult) -> str:
    """Return the verdict of a cell in words, as the rest of a sentence whose subject is the combination."""
    phase = result.cell.phase
    return {
        "unresolvable": "cannot be resolved",
        "uninstallable": "cannot be installed",
        "import_fails": "fails at import",
    }.get(str(result.cell.verdict), f"fails in {phase}" if phase else "does not work")


def _newness(result: CellResult, names: Iterable[str]) -> tuple[object, ...]:
    return tuple(version(str(result.version(name))) for name in names)


def _query(each: MeasuredSet, project: Project, env: str | None) -> Query:
    wanted = tuple(Wanted.of(project.packages[name].text) for name in each.names)
    return Query(wanted=wanted, env=env)


def _admits(
    each: MeasuredSet, trap: Red, fitting: Sequence[CellResult], project: Project, env: str | None
) -> CheckFinding:
    # Where a cause is known, its fix names the package that decides: of the locks, a trap compares what was chosen.
    decisive = {} if trap.causes else trap.deciding
    deciding = ", ".join(f"{name} {' or '.join(held[:FEW])}" for name, held in decisive.items())
    count = len(trap.versions)
    shown = "; ".join(", ".join(f"{name} {held}" for name, held in one.items()) for one in trap.versions[:FEW])
    more = f" and {count - FEW} more" if count > FEW else ""
    results = [result for result in fitting if result.cell.id in trap.cells]
    result = results[0]
    tasks = _tasks_of(results, project, env)
    fails = [task for task in tasks if not task.works]
    how = f"{len(fails)} of {len(tasks)} tasks fail: {_names(fails)}" if fails else word(result)
    return CheckFinding(
        kind=Kind.ADMITS,
        text=f"{shown}{more}{f' with {deciding}' if deciding else ''}: {how}",
        versions=trap.versions[0],
        python=result.python,
        measured=result.cell.measured,
        line=trap.line,
        cells=trap.cells,
        causes=trap.causes,
        bound=None if trap.deciding or trap.causes else _bound(each, trap, fitting),
        next=f"simmatrix show {trap.cells[0]}",
    )


def _bound(each: MeasuredSet, trap: Red, fitting: Sequence[CellResult]) -> str | None:
    """Return a bound on one package that parts the broken combinations from all that work; None if there is none."""
    good = [result for result in fitting if result.works]
    for name in each.names:
        broken = sorted({version(one[name]) for one in trap.versions})
        works = sorted({version(str(result.version(name))) for result in good})
        if works and works[-1] < broken[0]:
            return f"{name}<{broken[0]}"
        if works and works[0] > broken[-1]:
            return f"{name}>={works[0]}"
    return None


def _unmeasured(each: MeasuredSet, project: Project) -> CheckFinding:
    own = ", ".join(_own(project.packages[name]) for name in each.names)
    near = measured_sets.nearest(each.cells, project, each.names)
    python = f" on Python {project.python}" if project.python else ""
    text = f"{own}{python}: never measured"
    if near is None:
        return CheckFinding(kind=Kind.UNMEASURED, text=f"{text}, and nothing near works")
    words = shlex.join(["simmatrix", "try", *(_typed(project.packages[name]) for name in each.names)])
    minor = ".".join((project.python or near.python).split(".")[:2])
    return CheckFinding(
        kind=Kind.UNMEASURED,
        text=f"{text}; nearest that works: {_versions(near, each.names)} on Python {near.minor}{_apart(near, project)}",
        versions=_held(near, each.names),
        python=near.python,
        measured=near.cell.measured,
        cells=(near.cell.id,),
        next=f"{words} --python {minor}",
    )


def _typed(declared: Declared) -> str:
    extras = f"[{','.join(sorted(declared.extras))}]" if declared.extras else ""
    return f"{declared.name}{extras}{declared.versions}"


def _own(declared: Declared) -> str:
    return f"{declared.name} {declared.pinned}" if declared.pinned else declared.text


# --- bounds that keep out what works ---------------------------------------------------------------------------


def _excludes(each: MeasuredSet, fitting: Sequence[CellResult], project: Project) -> Iterator[CheckFinding]:
    """Yield each upper bound of a project that keeps out a newer release which works with all the rest."""
    for name in each.names:
        declared = project.packages[name]
        others = [clause for clause in declared.versions.clauses if clause.operator not in UPPER]
        if declared.by is not None or declared.pinned or len(others) == len(declared.versions.clauses):
            continue
        free = replace(declared, versions=specifiers(",".join(map(str, others))))
        wider = replace(project, packages={**project.packages, name: free})
        newest = max((_newness(result, [name]) for result in fitting), default=())
        beyond = [
            result
            for result in each.cells
            if result.works and _newness(result, [name]) > newest and measured_sets.fits(result, wider)
        ]
        if beyond:
            best = max(beyond, key=lambda result: _newness(result, [name]))
            yield CheckFinding(
                kind=Kind.EXCLUDES,
                text=f"{declared.text} keeps out {_versions(best, each.names)}, which works on Python {best.minor}",
                versions=_held(best, each.names),
                python=best.python,
                measured=best.cell.measured,
                cells=(best.cell.id,),
            )


# --- behaviour -------------------------------------------------------------------------------------------------


def _of_behaviour(
    measured: Measured, project: Project, env: str | None, newest: Mapping[str, str]
) -> Iterator[CheckFinding]:
    """Yield, for each package whose releases a project leaves open, the environments that change between them.

    `newest` are the newest releases that work with all the rest.
    """
    series = [
        each
        for each in changes.nearest(changes.concerning(measured.series, project), project)
        if not project.packages[each.package].pinned and (env is None or bare(each.env, each.api) == env)
    ]
    crossed: dict[str, dict[str, dict[str, str]]] = {}
    tried: dict[str, set[str]] = {}
    apart: dict[str, dict[str, str]] = {}
    for each in series:
        declared = project.packages[each.package]
        admitted = [release for release in each.releases if is_version(release) and declared.versions.admits(release)]
        if len(admitted) > 1:
            name = bare(each.env, each.api)
            tried.setdefault(each.package, set()).add(name)
            apart.setdefault(each.package, {}).update(changes.other_versions(each, project))
            for step in changes.lasting(each, changes.steps_within(each, admitted[0], admitted[-1])):
                crossed.setdefault(each.package, {}).setdefault(step.after, {})[name] = step.text
    for package, releases in crossed.items():
        bound = _one_family(package, sorted(releases, key=version), newest.get(package))
        yield _crossing(project.packages[package], releases, len(tried[package]), apart[package], bound)


def _one_family(package: str, releases: Sequence[str], newest: str | None) -> str:
    """Return the bound within which nothing changes and the newest working release lies."""
    reached = [release for release in releases if newest is None or version(release) <= version(newest)]
    after = releases[len(reached)] if len(reached) < len(releases) else None
    parts = [f">={reached[-1]}" if reached else "", f"<{after}" if after else ""]
    return package + ",".join(filter(None, parts))


def _crossing(
    declared: Declared, releases: Mapping[str, Mapping[str, str]], count: int, apart: Mapping[str, str], bound: str
) -> CheckFinding:
    ordered = sorted(releases, key=version)
    names = sorted({name for changed in releases.values() for name in changed})
    with_others = ", ".join(f"{name} {held}" for name, held in sorted(apart.items()))
    text = (
        f"{declared.text} admits releases between which {len(names)} of {count} tasks behave otherwise:"
        f" {first_few(names, FEW)} (at {', '.join(ordered)}"
        f"{f'; measured with {with_others}' if with_others else ''})"
    )
    return CheckFinding(
        kind=Kind.CHANGES,
        text=text,
        versions={declared.name: ordered[-1]},
        line=next(
            f"at {ordered[-1]} {name}: {how.removeprefix('behaves otherwise; ')}"
            for name, how in sorted(releases[ordered[-1]].items())
        ),
        bound=bound,
        next=f"simmatrix upgrade {declared.name}",
    )


# --- in words --------------------------------------------------------------------------------------------------


def _held(result: CellResult, names: Iterable[str]) -> dict[str, str]:
    return {name: str(result.version(name)).partition("+")[0] for name in names}


def _versions(result: CellResult, names: Iterable[str]) -> str:
    return ", ".join(f"{name} {held}" for name, held in _held(result, names).items())


def _tasks(tasks: Sequence[Task]) -> str:
    return _names(tasks) if len(tasks) == 1 else f"{len(tasks)} tasks: {_names(tasks)}"


def _names(tasks: Sequence[Task]) -> str:
    return first_few(sorted(task.env for task in tasks), FEW)

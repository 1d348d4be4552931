"""Write the answer of `upgrade` for people: one line a question, then the command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from harness.model.report_types import first_few
from harness.reports.projects.changes import TaskChange
from harness.reports.projects.labelled_lines import labelled
from harness.reports.projects.upgrade_document import RunningTask, Sameness, Upgraded
from harness.standalone.versions import version

NAMED = 4
OTHERWISE = "behaves otherwise; "
WIDTH = 10


def lines(document: Upgraded, *, whole: bool = False) -> Iterator[str]:
    """Yield the lines; `whole` names every environment."""
    most = 1_000 if whole else NAMED
    named = [(f"{move.name} {move.now or 'none'} to {move.then}", move.pulled) for move in document.moves]
    moves = ", ".join(f"{'and with it ' if pulled else ''}{text}" for text, pulled in named)
    yield f"{moves} in {document.source}"
    yield _labelled("install", document.install.text)
    yield from (_labelled("", text) for text in document.install.blockers[1:most])
    yield from _running(document, most)
    yield from _sameness("behave", document.behaviour, "behave", document.tasks, most)
    yield from _sameness("pictures", document.pictures, "look", document.tasks, most)
    yield from (_labelled("newest", _newest(document, name)) for name in document.unchanging)
    yield from (f"  {line}" for line in document.command)


def tried_lines(document: Upgraded) -> Iterator[str]:
    """Yield what was measured for this answer."""
    for task in document.tried:
        now, then = ("runs" if works else "fails" for works in (task.runs_now, task.runs_then))
        because = f": {task.line}" if task.line else ""
        yield _labelled("tried", f"{task.env} {now} now, and {then} with the upgrade{because}")
        yield _labelled("", f"it {task.text}" if task.behaves_otherwise is not None else task.text)
        if task.left_out:
            yield _labelled("", f"{len(task.left_out)} other packages were left to the resolver")


def _running(document: Upgraded, most: int) -> Iterator[str]:
    works = [task for task in document.running if task.works]
    fails = [task for task in document.running if not task.works]
    count = len(document.tasks)
    missing = sorted({*document.tasks} - {task.env for task in document.running})
    if not document.running:
        tasks = f"none of {count} tasks was measured with it" if count else "no task of it was measured"
        yield _labelled("run", f"{tasks}: --try measures here")
        return
    yield _labelled("run", f"{len(works)} of {count} tasks were measured and work: {_where(works or fails, document)}")
    for task in fails[:most]:
        yield _labelled("", f"not {task.env}: {task.line or 'it fails'} (simmatrix show {task.cell})")
    if missing:
        yield _labelled("", f"not measured: {first_few(missing, most)}")


def _where(tasks: Sequence[RunningTask], document: Upgraded) -> str:
    task = tasks[0]
    python = ".".join(task.python.split(".")[:2])
    other = document.python is not None and not document.python.startswith(f"{python}.")
    there = [f"{name} {held}" for name, held in sorted(task.other_versions.items())]
    where = ", ".join([*([f"Python {python}"] if other else []), *there])
    return first_few(sorted(task.env for task in tasks), NAMED) + (f" (with {where})" if where else "")


def _sameness(label: str, sameness: Sameness, verb: str, tasks: Sequence[str], most: int) -> Iterator[str]:
    changing, count = sameness.changing, len({*tasks, *sameness.same, *sameness.changing})
    if not sameness.same and not changing:
        yield _labelled(label, "not measured")
        return
    apart = ", ".join(f"{name} {held}" for name, held in sorted(sameness.other_versions.items()))
    where = f" (measured with {apart})" if apart else ""
    if changing:
        yield _labelled(label, f"{len(changing)} of {count} tasks {verb} otherwise{where}: {first_few(changing, most)}")
        yield from (_labelled("", text) for text in _changes(sameness.changed, most))
    if sameness.same:
        yield _labelled(
            "" if changing else label, f"{len(sameness.same)} of {count} {verb} the same{where if not changing else ''}"
        )
    if sameness.between:
        names = first_few(sameness.between, most)
        yield _labelled("", f"by their neighbours, one of the releases was not measured itself: {names}")
    if sameness.starts:
        yield _labelled("", f"starts elsewhere under the same seed: {first_few(sameness.starts, most)}")
    if sameness.unmeasured:
        yield _labelled("", f"not measured: {first_few(sameness.unmeasured, most)}")


def _changes(changed: Sequence[TaskChange], most: int) -> Iterator[str]:
    """Yield one line for each release at which something changes, with the environment named first."""
    releases: dict[tuple[str, str], list[TaskChange]] = {}
    for change in changed:
        releases.setdefault((change.package, change.after), []).append(change)
    ordered = sorted(releases.items(), key=lambda item: (item[0][0], version(item[0][1])))
    for (_, release), alike in ordered[:most]:
        names = first_few(sorted({change.env for change in alike}), most)
        moved = f"; not separated from {', '.join(alike[0].moved)}" if alike[0].moved else ""
        yield f"at {release}: {names}; {alike[0].env}: {alike[0].text.removeprefix(OTHERWISE)}{moved}"
    if len(ordered) > most:
        yield f"and at {len(ordered) - most} more releases: --all"


def _newest(document: Upgraded, name: str) -> str:
    release = document.unchanging[name]
    now = next(move.now for move in document.moves if move.name == name)
    if release is None:
        return f"no newer {name} is known that changes nothing" if now else f"{name} is not there yet"
    return f"that changes nothing, as far as was measured: {name}=={release}"


def _labelled(label: str, text: str) -> str:
    return labelled(label, text, WIDTH)

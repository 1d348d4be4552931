"""Find the content of a first matrix: environments of the installed package, its tests, versions that install."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from harness.ci import drafts, first_cases, first_values, workflows
from harness.ci.drafts import Case, Draft, Project, Range
from harness.ci.drafts.values import exclude, narrow
from harness.ci.first_cases import FirstCases, Scout
from harness.machine import interpreters, store
from harness.model import replace
from harness.model.errors import BadInput, HarnessError
from harness.model.vocabulary import GYM, GYMNASIUM, HOST
from harness.packages import index
from harness.reports.text import progress
from harness.running import open_matrix

NOT_SOURCES = frozenset({"build", "dist", "docs", "doc", "examples", "test", "tests", "node_modules", "site-packages"})
LARGEST = 2_000_000
"""Bytes of a file in which environments are looked for."""


def cases(about: Project, pythons: Sequence[str], *, offline: bool) -> FirstCases:
    """Ask the installed package; where it cannot be installed here, take what its sources seem to register."""
    opened = store.open_store()
    order = first_cases.by_preference(pythons, None)
    with progress.Progress(0, 1, progress.headline) as board:
        scout = Scout(
            opened=opened,
            observer=board,
            folder=Path.cwd(),
            instant=store.now(),
            offline=offline,
            extras=drafts.runtime(about.extras),
        )
        discovery = scout.look(order)
    if discovery.importable:
        return discovery
    case = _in_sources()
    return replace(discovery, cases=(case,) if case else ())


def complete(draft: Draft, about: Project, discovery: FirstCases, *, offline: bool) -> Draft:
    """Return the draft with cases, the extras that they need, the tests, and ranges of what can be installed."""
    baseline = draft.baseline
    ranges = draft.ranges if offline or not baseline else tuple(_narrowed(draft.ranges, baseline))
    extras, notes = _known_extras(draft, about)
    return replace(
        draft,
        cases=discovery.cases,
        extras=tuple(dict.fromkeys((*extras, *discovery.extras))),
        suite=_suite(about),
        ranges=ranges,
        notes=(*draft.notes, *notes, *discovery.notes),
    )


def without_clashes(draft: Draft, path: Path) -> Draft:
    """Return the draft of a written matrix without values that only clash with the newest release of another axis."""
    packages = [each.package for each in draft.ranges]
    if not packages:  # nothing but the project's own requirements can stand against a value
        return draft
    opened = store.open_store()
    try:
        planned = open_matrix.set_instant(open_matrix.load(str(path), lambda _: None), opened)
    except HarnessError:  # it is loaded again right after, and says it then
        return draft
    with progress.Progress(0, 1, progress.headline) as board:
        clashes = first_values.find_clashes(planned.cells, packages, opened, board)
    gone = clashes.get(first_values.PYTHON, ())
    note = f"Left out: Python {', '.join(gone)}, on which the newest releases of the axes cannot be installed."
    return replace(
        draft,
        # The ranges were narrowed for this Python. With some Pythons left out another one would be in the middle.
        main=draft.baseline,
        pythons=tuple(python for python in draft.pythons if python not in gone),
        ranges=tuple(exclude(each, clashes.get(each.package, ())) for each in draft.ranges),
        notes=(*draft.notes, *([note] if gone else [])),
    )


def _known_extras(draft: Draft, about: Project) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the extras of a draft that the project has; a workflow may name others, of which pip only warns."""
    unknown = [extra for extra in draft.extras if about.extras and extra not in about.extras]
    extras = tuple(extra for extra in draft.extras if extra not in unknown)
    return extras, tuple(f"Left out: the extra {extra}, which the project does not have." for extra in unknown)


def _narrowed(ranges: Sequence[Range], python: str) -> Iterator[Range]:
    version = _minor(python)
    for each in ranges:
        try:
            releases = index.releases(each.package)
        except HarnessError:  # the range is expanded right after, and says it then
            yield each
            continue
        yield narrow(each, releases, version)


def _minor(python: str) -> str:
    """Return a Python as wheels name it: `3.11`."""
    interpreter = interpreters.find(HOST) if python == HOST else None
    return interpreter.minor if interpreter else ".".join(python.split(".")[:2])


def _suite(about: Project) -> drafts.SuiteDraft | None:
    folders = [path.name for path in sorted(Path().iterdir()) if path.is_dir()]
    return drafts.draft_suite(
        about.extras, about.groups, folders, in_workflow=_extras_of_workflows(), configured=about.test_paths
    )


def _extras_of_workflows() -> Iterator[str]:
    """Yield the extras that the project's own workflows install where they run pytest."""
    for path in sorted(Path(".github/workflows").glob("*.y*ml")):
        text = path.read_text(encoding="utf-8", errors="replace")
        try:
            jobs = workflows.read(text, str(path)) if "pytest" in text else ()
        except BadInput:  # no matrix, or no workflow
            continue
        for job in jobs:
            for leg in job.legs:
                yield from leg.extras or ()


# --- without an installed package ------------------------------------------------------------------------------


def _in_sources() -> Case | None:
    """Return the first environment that the sources register, in its newest version."""
    environments = dict.fromkeys(_registered())
    for first, api in environments:
        name = first.rpartition("-v")[0]
        newest = max((int(env.rpartition("-v")[2]), env) for env, _ in environments if env.rpartition("-v")[0] == name)
        return Case(env=newest[1], api=api, note="Found in the sources, and not tried.")
    return None


def _registered() -> Iterator[tuple[str, str]]:
    for path in sorted(Path().rglob("*.py")):
        if NOT_SOURCES & {*path.parts} or any(part.startswith(".") for part in path.parts):
            continue
        if path.stat().st_size <= LARGEST:
            text = path.read_text(encoding="utf-8", errors="replace")
            api = GYMNASIUM if "gymnasium" in text else GYM
            yield from ((env, api) for env in (drafts.environment_ids(text) if "register" in text else ()))

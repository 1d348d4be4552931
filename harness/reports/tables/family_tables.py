"""Regroup behaviour into a table: a row for each environment, a column for each range of releases that behave alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Literal, TypeVar

import msgspec
from msgspec import Struct

from harness.model import replace
from harness.model.report_types import BoundaryEntry, CaseEntry, CellEntry, ConsequenceEntry
from harness.physics.families import release_order
from harness.physics.relation import STARTS

ABSENT = "-"
"""The mark of an environment that was not measured with a release."""


EXERCISED: tuple[Literal["contact", "limit", "equality"], ...] = ("contact", "limit", "equality")
"""Constraints that a state may exercise."""

T = TypeVar("T")
N = TypeVar("N", CaseEntry, BoundaryEntry)


class ReleaseStep(Struct, frozen=True, kw_only=True):
    """The relation of a release to the one measured before it, for one environment.

    `size` is the median relative difference in the states that differ, 0 where nothing has a size.
    """

    kind: str
    size: float = 0.0
    starts_otherwise: bool = False


class FamilyTable(Struct, frozen=True, kw_only=True):
    """The families along one axis, with all other axes as they stand in `where`.

    `columns` are ranges of releases, `rows` are environments with their family in each range: a letter, `-` where it
    was not measured, several letters where the range has several. `steps` are the environments with a step for each of
    `releases`: None for the first that was measured, and for those that were not. `picture` is a plot of them, a file
    beside the report. `coverage` has environments with the shares of `EXERCISED`.
    """

    axis: str
    where: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]
    measured: int
    changed: int
    tasks: int
    releases: tuple[str, ...]
    steps: Mapping[str, tuple[ReleaseStep | None, ...]]
    coverage: tuple[tuple[str, tuple[float, ...]], ...]
    picture: str

    @property
    def subject(self) -> str:
        """Return the packages whose releases these are: those in the values (`gym-0.26.2`), else the axis."""
        names = dict.fromkeys(release_order(value)[0] for column in self.columns for value in column.split(" to "))
        return " and ".join(filter(None, names)) or self.axis


class Change(Struct, frozen=True, kw_only=True):
    """All that changes between two neighbouring releases: each environment with what differs there.

    `moved` says which other packages differ, too; then the change is not separated from them.
    """

    axis: str
    before: str
    after: str
    between: tuple[str, ...]
    moved: str
    lines: tuple[tuple[str, str], ...]
    cells: tuple[str, str]
    changelog: str

    @property
    def title(self) -> str:
        """Return both releases, with the name of the axis unless they name their packages themselves."""
        named = f"{self.before} to {self.after}"
        return named if release_order(self.before)[0] else f"{self.axis} {named}"


def call_by_ids(
    cells: Sequence[CellEntry], boundaries: Iterable[BoundaryEntry]
) -> tuple[tuple[CellEntry, ...], tuple[BoundaryEntry, ...]]:
    """Return both, with the id of the case in place of an environment that several cases of a cell share."""
    counts = [Counter(case.env for case in cell.cases) for cell in cells]
    shared = {env for count in counts for env in count if env and count[env] > 1}

    def called(entry: N) -> N:
        return msgspec.structs.replace(entry, env=entry.case) if entry.env in shared else entry

    renamed = tuple(msgspec.structs.replace(cell, cases=tuple(map(called, cell.cases))) for cell in cells)
    return renamed, tuple(map(called, boundaries))


def tables(
    cells: Sequence[CellEntry], axes: Sequence[str], boundaries: Iterable[BoundaryEntry] = ()
) -> tuple[FamilyTable, ...]:
    """Return a table for each axis along which releases were compared."""
    sizes = {(one.axis, one.cells[1], one.env or one.case): one for one in boundaries}
    behaving = [cell for cell in cells if any(case.behaviour for case in cell.cases)]
    result = []
    for axis in axes:
        if axis == "python" or len({cell.axes.get(axis) for cell in behaving}) < 2:
            continue
        groups: dict[tuple[tuple[str, str], ...], list[CellEntry]] = {}
        for cell in behaving:
            rest = tuple(sorted((name, value) for name, value in cell.axes.items() if name != axis))
            groups.setdefault(rest, []).append(cell)
        result += [_table(axis, rest, group, sizes) for rest, group in groups.items() if len(group) > 1]
    return tuple(replace(table, picture=f"behaviour-{number}.svg") for number, table in enumerate(result, start=1))


def _table(
    axis: str,
    rest: tuple[tuple[str, str], ...],
    cells: list[CellEntry],
    sizes: Mapping[tuple[str, str, str], BoundaryEntry],
) -> FamilyTable:
    by_release = sorted(cells, key=lambda cell: release_order(cell.axes[axis]))
    envs = list(dict.fromkeys(case.env or case.case for cell in by_release for case in cell.cases if case.behaviour))
    families = {env: [_family(cell, env) for cell in by_release] for env in envs}
    starts = [0, *(n + 1 for n, pair in enumerate(pairwise(range(len(by_release)))) if _differ(families, *pair))]
    ranges = list(pairwise([*starts, len(by_release)]))
    releases = [cell.axes[axis] for cell in by_release]
    rows = {env: tuple("".join(dict.fromkeys(families[env][start:end])) for start, end in ranges) for env in envs}
    letters = {env: {letter.rstrip("?'") for letter in families[env] if letter != ABSENT} for env in envs}
    return FamilyTable(
        axis=axis,
        where=", ".join(f"{name} {value}" for name, value in rest),
        columns=tuple(
            releases[start] if end == start + 1 else f"{releases[start]} to {releases[end - 1]}"
            for start, end in ranges
        ),
        rows=_joined(rows),
        measured=len(by_release),
        changed=sum(len(family) > 1 for family in letters.values()),
        tasks=len(envs),
        releases=tuple(releases),
        steps={env: tuple(_step(cell, env, sizes.get((axis, cell.id, env))) for cell in by_release) for env in envs},
        coverage=_coverage(by_release, envs),
        picture="",
    )


def _coverage(cells: Iterable[CellEntry], envs: Iterable[str]) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return the shares of states of each environment, as the first release has them that was measured with it."""
    entries = [(case.env or case.case, case.behaviour) for cell in cells for case in cell.cases if case.behaviour]
    first = {env: entry.coverage for env, entry in reversed(entries) if entry and entry.coverage}
    shares = {env: tuple(first[env].get(kind, 0.0) for kind in EXERCISED) for env in envs if env in first}
    return _joined(shares)


def _step(cell: CellEntry, env: str, boundary: BoundaryEntry | None) -> ReleaseStep | None:
    entry = next((case.behaviour for case in cell.cases if (case.env or case.case) == env), None)
    if not entry or entry.reference is None:
        return None
    if boundary is None:
        return ReleaseStep(kind=entry.classes["sum"])
    return ReleaseStep(kind=boundary.kind, size=boundary.median, starts_otherwise=boundary.start in STARTS)


def _joined(rows: Mapping[str, tuple[T, ...]]) -> tuple[tuple[str, tuple[T, ...]], ...]:
    """Return the rows, versions of one environment that have the same values in one: `Ant-v4, v5`."""
    groups: dict[tuple[str, tuple[T, ...]], list[str]] = {}
    for env, values in sorted(rows.items()):
        stem, dash, version = env.rpartition("-v")
        groups.setdefault((stem if dash else env, values), []).extend([version] if dash else [])
    return tuple(
        (f"{stem}-v{', v'.join(versions)}" if versions else stem, values) for (stem, values), versions in groups.items()
    )


def _family(cell: CellEntry, env: str) -> str:
    entry = next((case.behaviour for case in cell.cases if (case.env or case.case) == env), None)
    return entry.family if entry else ABSENT


def _differ(families: dict[str, list[str]], first: int, second: int) -> bool:
    return any(letters[first] != letters[second] for letters in families.values())


def changes(boundaries: Iterable[BoundaryEntry]) -> tuple[Change, ...]:
    """Return the boundaries, those of the same two releases together."""
    groups: dict[tuple[object, ...], list[BoundaryEntry]] = {}
    for first in boundaries:
        key = (first.axis, release_order(first.before), first.before, first.after, first.between, str(first.moved))
        groups.setdefault(key, []).append(first)
    ordered = sorted(groups.values(), key=lambda group: (group[0].axis, release_order(group[0].before), group[0].cells))
    return tuple(_change(group) for group in ordered)


def _change(group: list[BoundaryEntry]) -> Change:
    first = group[0]
    moved = ", ".join(f"{name} {one or 'absent'} to {other or 'absent'}" for name, (one, other) in first.moved.items())
    lines = _joined({one.env or one.case: (one.text,) for one in group})
    return Change(
        axis=first.axis,
        before=first.before,
        after=first.after,
        between=first.between,
        moved=moved,
        lines=tuple((envs, text) for envs, (text,) in lines),
        cells=first.cells,
        changelog=first.changelog,
    )


def consequence_lines(entries: Iterable[ConsequenceEntry]) -> tuple[tuple[str, str], ...]:
    """Return each task and step between two releases, with the effect on a policy; tasks in their order."""
    return tuple((f"{one.case}, {_step_title(one)}", one.text) for one in entries)


def _step_title(entry: ConsequenceEntry) -> str:
    """Return the package that moved with both versions, and what moved besides; the releases if nothing moved."""
    moved = sorted(entry.moved, key=lambda name: (name not in entry.before, name != entry.axis, name))
    if not moved:
        return f"{entry.axis} {entry.before} to {entry.after}"
    before, after = entry.moved[moved[0]]
    others = f" (and {', '.join(moved[1:])})" if moved[1:] else ""
    return f"{moved[0]} {before or 'absent'} to {after or 'absent'}{others}"

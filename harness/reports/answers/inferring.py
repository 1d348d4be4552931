"""Infer combinations that probably work from measured ones; they are marked as inferred wherever they are shown.

Little can be inferred. A version probably works if it lies between two that work with everything else equal, on the
same Python and machine, and if nothing was measured with it. The same holds for a Python between two.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import msgspec
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.model import replace
from harness.reports.answers.measured_cells import CellResult, Query, Wanted, find_fitting, find_good

PYTHON = "python"


class Inferred(msgspec.Struct, frozen=True, kw_only=True):
    """A combination that was not measured but probably works, on `python`.

    `why` is a sentence, `from_cells` are the cells that it follows from. `kind` is `between`: it lies between two
    combinations that work.
    """

    kind: str
    versions: dict[str, str]
    python: str
    why: str
    from_cells: tuple[str, ...]


def infer(cells: Sequence[CellResult], query: Query) -> list[Inferred]:
    """Return the combinations inferred for a question that no measurement answers."""
    return [*_versions_between(cells, query), *_pythons_between(cells, query)]


# --- between ---------------------------------------------------------------------------------------------------


def _versions_between(cells: Sequence[CellResult], query: Query) -> Iterator[Inferred]:
    """Yield a pinned version that lies between two versions that work.

    No cell may hold it together with everything else that was asked for.
    """
    # Any measurement of the pinned version is an answer, on whichever Python and of whichever environment.
    seen = bool(find_fitting(cells, Query(wanted=query.wanted)))
    for place, wanted in enumerate(() if seen else query.wanted):
        pinned = _pin(wanted)
        free = replace(wanted, versions=SpecifierSet())
        other = replace(query, wanted=(*query.wanted[:place], free, *query.wanted[place + 1 :]))
        for before, after in _neighbours(cells, other, wanted.name) if pinned else ():
            low, high = (Version(str(one.version(wanted.name))) for one in (before, after))
            # By their numbers they should be compatible: the same major version, or the same 0.x.
            near = low.major == high.major and (low.major > 0 or low.minor == high.minor)
            if pinned and low < pinned < high and near:
                yield Inferred(
                    kind="between",
                    versions={name: str(before.version(name)) for name in query.names} | {wanted.name: str(pinned)},
                    python=before.python,
                    why=f"{wanted.name} {pinned} lies between {low} and {high}, both measured good with the same"
                    f" {_rest(before, wanted.name)}",
                    from_cells=(before.cell.id, after.cell.id),
                )


def _pythons_between(cells: Sequence[CellResult], query: Query) -> Iterator[Inferred]:
    """Yield a Python without measurements that lies between two on which the same versions work."""
    if query.python is None or find_fitting(cells, replace(query, needs=(), env=None)):
        return
    target = Version(query.python)
    for before, after in _neighbours(cells, replace(query, python=None), PYTHON):
        if Version(before.minor) < target < Version(after.minor):
            yield Inferred(
                kind="between",
                versions={name: str(before.version(name)) for name in query.names},
                python=query.python,
                why=f"Python {query.python} lies between {before.minor} and {after.minor}, on both of which the same"
                f" versions were measured good: {_rest(before, PYTHON)}",
                from_cells=(before.cell.id, after.cell.id),
            )


def _neighbours(cells: Sequence[CellResult], query: Query, axis: str) -> Iterator[tuple[CellResult, CellResult]]:
    """Yield pairs of working cells that differ in one axis only, with no other cell between them."""

    def place(result: CellResult) -> Version:
        return Version(result.minor if axis == PYTHON else str(result.version(axis)))

    # Red cells stay in the row, so that nothing is inferred across one.
    for alike in _alike(find_fitting(cells, replace(query, needs=(), env=None)), axis):
        for before, after in pairwise(sorted(alike, key=place)):
            if len(find_good((before, after), query)) == 2 and place(before) < place(after):
                yield before, after


def _pin(wanted: Wanted) -> Version | None:
    """Return the version if exactly one is asked for (`==`), else None."""
    parts = list(wanted.versions)
    if len(parts) == 1 and parts[0].operator == "==" and not parts[0].version.endswith("*"):
        return Version(parts[0].version)
    return None


def _alike(cells: Iterable[CellResult], apart_from: str) -> list[list[CellResult]]:
    """Group cells of one matrix and machine that differ in one axis and in nothing else that was chosen."""
    groups: dict[Any, list[CellResult]] = {}
    for result in cells:
        cell = result.cell
        if apart_from in cell.axes:
            variables, repaired = tuple(sorted(cell.environment.items())), tuple(one.package for one in cell.repairs)
            axes = sorted((name, value) for name, value in cell.axes.items() if name != apart_from)
            key = (cell.matrix, cell.machine, cell.base and cell.id, tuple(axes), variables, repaired)
            groups.setdefault(key, []).append(result)
    return list(groups.values())


def _rest(result: CellResult, apart_from: str) -> str:
    """Return the other chosen versions in words, such as `Python 3.11, mujoco 3.3.7`."""
    chosen = {"Python": result.minor} if apart_from != PYTHON else {}
    chosen |= {name: version for name, version in result.chosen.items() if name != apart_from}
    return ", ".join(f"{name} {version}" for name, version in chosen.items())

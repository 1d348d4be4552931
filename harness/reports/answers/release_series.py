"""Read from a report which environments behave, or look, otherwise between the releases of a package.

The hook that builds our wheel imports this module, too, where no NumPy is: it takes nothing from `physics`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

import msgspec
from packaging.utils import canonicalize_name

from harness.model.measured import ReleaseSeries, SeriesStep
from harness.model.report_types import (
    BehaviourEntry,
    BoundaryEntry,
    CaseEntry,
    CellEntry,
    Document,
    PictureDifferenceEntry,
    PicturesEntry,
)
from harness.model.vocabulary import required_name
from harness.standalone.versions import is_version, version

PYTHON = "python"
LEAST = 2
"""Releases of a series: one alone says nothing."""


def read_series(report: Document) -> list[ReleaseSeries]:
    """Return the series of a report: behaviour first, then pictures."""
    return [*_of_behaviour(report), *_of_pictures(report)]


# --- behaviour -------------------------------------------------------------------------------------------------


def _of_behaviour(report: Document) -> Iterator[ReleaseSeries]:
    steps: dict[tuple[str, str, str], BoundaryEntry] = {
        (boundary.case, *boundary.cells): boundary for boundary in report.boundaries or ()
    }
    lines: dict[tuple[str, str | None, str, str, str, tuple[tuple[str, str], ...]], list[tuple[CellEntry, CaseEntry]]]
    lines = {}
    for cell in report.cells:
        for axis in cell.axes if cell.base is None else ():
            rest = tuple((name, value) for name, value in sorted(cell.axes.items()) if name != axis)
            for case in cell.cases if axis != PYTHON else ():
                if case.behaviour is not msgspec.UNSET and case.env:
                    key = cell.matrix, cell.machine, case.case, axis, _package(axis, cell), rest
                    lines.setdefault(key, []).append((cell, case))
    for (matrix, _, _, axis, package, rest), measured in lines.items():
        if len(measured) >= LEAST:
            yield _series(matrix, axis, package, dict(rest), measured, steps)


def _series(
    matrix: str,
    axis: str,
    package: str,
    where: dict[str, str],
    measured: list[tuple[CellEntry, CaseEntry]],
    steps: Mapping[tuple[str, str, str], BoundaryEntry],
) -> ReleaseSeries:
    ordered = sorted(measured, key=lambda each: _order(_release(each[0].axes[axis])))
    case = ordered[0][1]
    cells = [cell.id for cell, _ in ordered]
    pairs = [(case.case, before, after) for before, after in pairwise(cells)]
    return ReleaseSeries(
        matrix=matrix,
        env=str(case.env),
        api=case.api,
        package=package,
        where={**where, **_beside(*ordered[0], package)},
        releases=tuple(_release(cell.axes[axis]) for cell, _ in ordered),
        families=tuple(_family(case) for _, case in ordered),
        steps=tuple(_step(steps[pair]) for pair in pairs if pair in steps),
    )


def _beside(cell: CellEntry, case: CaseEntry, package: str) -> dict[str, str]:
    """Return the installed versions of the other packages that a cell asks for by name and that a case ran."""
    names = {canonicalize_name(required_name(text)) for text in cell.requirements} - {package}
    names &= {*(case.exercised or names)}
    return {name: version for name, version in sorted((cell.installed or {}).items()) if name in names}


def _family(case: CaseEntry) -> str:
    return case.behaviour.family if isinstance(case.behaviour, BehaviourEntry) else "-"


def _step(boundary: BoundaryEntry) -> SeriesStep:
    return SeriesStep(
        before=_release(boundary.before),
        after=_release(boundary.after),
        kind=boundary.kind,
        text=boundary.text,
        share=round(boundary.share, 4),
        moved=tuple(boundary.moved),
        between=tuple(map(_release, boundary.between)),
    )


def _package(axis: str, cell: CellEntry) -> str:
    """Return the package that a value of an axis sets: of a bundle, the first part of `gym-0.26.2`."""
    name, dash, _ = cell.axes[axis].rpartition("-")
    bundle = canonicalize_name(name) if dash else ""
    return bundle if bundle in (cell.installed or {}) else canonicalize_name(axis)


def _release(value: str) -> str:
    return value.rpartition("-")[2]


def _order(release: str) -> tuple[bool, object]:
    return (True, version(release)) if is_version(release) else (False, release)


# --- pictures --------------------------------------------------------------------------------------------------


def _of_pictures(report: Document) -> Iterator[ReleaseSeries]:
    apis = {case.env: case.api for cell in report.cells for case in cell.cases if case.env}
    besides = {
        (case.env, axis): _beside(cell, case, canonicalize_name(axis))
        for cell in report.cells
        for case in cell.cases
        for axis in cell.axes
        if case.frames
    }
    for entry in report.pictures or ():
        for env, letters in entry.letters.items():
            drawn = [(release, each) for release, each in zip(entry.releases, letters, strict=True) if each != "-"]
            if len(drawn) >= LEAST:
                yield ReleaseSeries(
                    matrix=entry.matrix,
                    env=env,
                    api=apis.get(env, ""),
                    package=canonicalize_name(entry.axis),
                    where={**entry.where, **besides.get((env, entry.axis), {})},
                    releases=tuple(_release(release) for release, _ in drawn),
                    families=tuple(each for _, each in drawn),
                    steps=tuple(_picture_steps(entry, env)),
                    pictures=True,
                )


def _picture_steps(entry: PicturesEntry, env: str) -> Iterator[SeriesStep]:
    for boundary in entry.boundaries:
        for difference in boundary.differences:
            if (difference.env or difference.case) == env:
                yield SeriesStep(
                    before=_release(boundary.before),
                    after=_release(boundary.after),
                    kind=difference.kind,
                    text=_describe(difference),
                    share=difference.share,
                    moved=tuple(boundary.moved),
                )


def _describe(difference: PictureDifferenceEntry) -> str:
    parts = f"; what moved: {', '.join(difference.moved)}" if difference.moved else ""
    return f"is drawn otherwise in {max(difference.share, 0.001):.1%} of the picture{parts}"

"""Add pictures to a document: how each environment looks in each release, and between which releases that changes.

Nothing is measured or drawn. Cells are compared along one line for each axis: the one with the most pictures.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Literal

import msgspec

from harness.model import CellRecord, Plan
from harness.model.report_types import Document, PictureBoundaryEntry, PictureDifferenceEntry, PicturesEntry
from harness.model.vocabulary import DRAW
from harness.physics import families, pixels
from harness.physics.pixels import Drawings
from harness.physics.relation import Look, PixelComparison
from harness.probes.vault import Vault
from harness.reports.pictures import stored_pictures
from harness.reports.pictures.first_pictures import RENDER

ABSENT = "-"
"""The mark of an environment that was not drawn with a release."""

Line = Mapping[str, CellRecord]
"""The cells along one axis, by its value, in the order of releases."""


def add(document: Document, records: Iterable[CellRecord], plans: Sequence[Plan], vault: Vault) -> Document:
    """Return the document with its pictures; the same one where no two cells drew the same case.

    Pictures after a reset, which no case asks to compare, are left out along an axis on which none differs.
    """
    by_matrix: dict[str, list[CellRecord]] = {}
    for record in records:
        if record.cell.base is None:
            by_matrix.setdefault(record.cell.matrix, []).append(record)
    entries = [entry for plan in plans for entry in _matrix(plan, by_matrix.get(plan.matrix, []), vault)]
    return msgspec.structs.replace(document, pictures=tuple(entries)) if entries else document


def _matrix(plan: Plan, records: Sequence[CellRecord], vault: Vault) -> Iterator[PicturesEntry]:
    for axis in plan.axes:
        line = {} if axis == "python" else longest_line(axis, records)
        if len(line) > 1:
            yield from _pictures(plan.matrix, axis, line, vault)


def longest_line(axis: str, records: Iterable[CellRecord]) -> Line:
    """Return the cells that differ in this axis alone and draw the most cases together."""
    groups: dict[tuple[object, ...], dict[str, CellRecord]] = {}
    for record in records:
        if axis in record.cell.axes and _draws(record):
            rest = tuple(sorted((name, value) for name, value in record.cell.axes.items() if name != axis))
            groups.setdefault((record.machine, *rest), {})[record.cell.axes[axis]] = record
    longest = max(groups.values(), key=lambda line: sum(map(_draws, line.values())), default={})
    return {value: longest[value] for value in sorted(longest, key=families.release_order)}


def _draws(record: CellRecord) -> int:
    """Return how many cases of a cell are to be drawn."""
    return len(_drawn_cases(record))


def _drawn_cases(record: CellRecord) -> set[str]:
    return {case.id for case in record.cell.cases if {DRAW, RENDER} & {*case.checks}}


def _pictures(matrix: str, axis: str, line: Line, vault: Vault) -> Iterator[PicturesEntry]:
    for method, read in (("states", stored_pictures.of_states), ("start", stored_pictures.of_start)):
        drawn: dict[tuple[str, str | None], dict[str, Drawings]] = {}
        for value, record in line.items():
            wanted = _drawn_cases(record)
            for case in (case for case in record.cases if case.case in wanted):
                picture = read(case, vault)
                if picture and picture.by_state:
                    drawn.setdefault((case.case, case.env), {})[value] = picture
        compared = {case: pictures for case, pictures in drawn.items() if len(pictures) > 1}
        if compared:
            entry = _entry(matrix, axis, line, "states" if method == "states" else "start", compared)
            if entry.boundaries or method == "states":
                yield entry
            return


def _entry(
    matrix: str,
    axis: str,
    line: Line,
    method: Literal["states", "start"],
    drawn: Mapping[tuple[str, str | None], Mapping[str, Drawings]],
) -> PicturesEntry:
    letters: dict[str, tuple[str, ...]] = {}
    pairs: dict[tuple[str, str], list[tuple[tuple[str, str | None], PixelComparison]]] = {}
    for (case, env), pictures in drawn.items():
        compare_pictures = _Comparisons(pictures)
        families_of_case = pixels.families(list(pictures), compare_pictures)
        letters[env or case] = tuple(families_of_case.get(value, ABSENT) for value in line)
        for pair in pairwise(pictures):
            pairs.setdefault(pair, []).append(((case, env), compare_pictures(*pair)))
    places = list(line)
    ordered = sorted(pairs, key=lambda pair: (places.index(pair[0]), places.index(pair[1])))
    boundaries = [_boundary(pair, line, pairs[pair]) for pair in ordered]
    first = next(iter(line.values())).cell.axes
    return PicturesEntry(
        matrix=matrix,
        axis=axis,
        where={name: value for name, value in sorted(first.items()) if name != axis},
        method=method,
        releases=tuple(line),
        letters=letters,
        boundaries=tuple(boundary for boundary in boundaries if boundary.differences),
    )


class _Comparisons:
    """Compares the pictures of two releases, each pair once."""

    def __init__(self, pictures: Mapping[str, Drawings]) -> None:
        self._pictures = pictures
        self._cache: dict[tuple[str, str], PixelComparison] = {}

    def __call__(self, first: str, second: str) -> PixelComparison:
        if (first, second) not in self._cache:
            self._cache[first, second] = pixels.compare(self._pictures[first], self._pictures[second])
        return self._cache[first, second]


def _boundary(
    pair: tuple[str, str], line: Line, comparisons: Iterable[tuple[tuple[str, str | None], PixelComparison]]
) -> PictureBoundaryEntry:
    first, second = line[pair[0]], line[pair[1]]
    moved = families.moved_packages(first.installed or {}, second.installed or {})
    axis = next(name for name in first.cell.axes if first.cell.axes[name] != second.cell.axes[name])
    package = next(iter(moved)) if len(moved) == 1 else axis
    compared = [(case, comparison) for case, comparison in comparisons if comparison.kind is not Look.NOT_COMPARABLE]
    return PictureBoundaryEntry(
        before=pair[0],
        after=pair[1],
        cells=(first.cell.id, second.cell.id),
        tasks=len(compared),
        moved={name: versions for name, versions in moved.items() if name != package},
        differences=tuple(
            PictureDifferenceEntry(
                case=case,
                env=env,
                kind=comparison.kind,
                share=round(comparison.share, 4),
                median=round(comparison.median, 4),
                distance=round(comparison.distance, 3),
                moved=tuple(comparison.moved),
                compared=tuple(comparison.compared),
            )
            for (case, env), comparison in compared
            if comparison.kind is not Look.IDENTICAL
        ),
    )

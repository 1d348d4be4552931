"""Multiply the axes: every combination becomes a cell, or is dropped for a reason."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import chain, product
from math import prod
from pathlib import PurePosixPath
from typing import NamedTuple

from harness.matrix.matrix_types import ExpectTable, Matrix, Value
from harness.matrix.plan.changing import Changing
from harness.matrix.plan.choices import Choice, Combination, Condition, choice_of, choices, condition
from harness.matrix.plan.contents import Contents
from harness.matrix.plan.covering import number_of_parts
from harness.matrix.plan.sources import Sources
from harness.matrix.plan.strategies import Axes, Candidates, baseline_combinations
from harness.model import Case, Cell, Dropped, Expectation, Plan, Suite, cellid, decoding, replace
from harness.model.cellid import CellId
from harness.model.errors import BadInput
from harness.model.schema import locate_errors, suggestion
from harness.model.vocabulary import Kind

NO_CASE = "no case exists for it"

MOST = 20_000
"""Combinations of a matrix, with what its changes make of them: some seconds of planning."""

MOST_PARTS = 200_000
"""Parts that a covering array may have to cover: some seconds."""


def make_plan(sources: Sources) -> Plan:
    """Plan a matrix, from all that was read and asked for it. Raises BadInput or ValueError naming the place."""
    matrix = sources.matrix
    axes, contents, sorted_out = _all(sources)
    choice = _candidates(sources, axes, contents, sorted_out)
    sorted_out.planned = choice.chosen(sources.expansion)
    for index, table in enumerate(matrix.include):
        with locate_errors(matrix.path, "include", index, "axes"):
            _include(sorted_out, matrix, _combination(matrix, axes, table.axes, sources.host_python), contents)
    changing = Changing(matrix, contents, sorted_out.claim)
    cells, unmet = _cells(matrix, sorted_out.planned, contents, changing)
    variants, unused = _variants(matrix, sorted_out.planned)
    _check_subjects(sources, contents)
    return Plan(
        matrix=matrix.name,
        cells=cells,
        dropped=(
            *(Dropped(id=name, reason=reason) for name, reason in sorted_out.dropped.items()),
            *(Dropped(id=name, reason=reason) for name, reason in changing.dropped.items()),
            *choice.left_out(sorted_out.planned, sources.expansion),
        ),
        stale=(
            *sorted_out.stale,
            *unmet,
            *unused,
            *changing.stale(_file(matrix)),
            *_unused_cases(matrix, cells, contents.places(chain.from_iterable(axes.values()))),
        ),
        axes=tuple(matrix.axes),
        shown=matrix.shown,
        snapshot=contents.snapshot,
        pivot=matrix.pivot,
        title=matrix.title,
        variants=variants,
        page=sources.texts[matrix.page] if matrix.page else None,
        banks=dict(sources.banks.values()),
    )


def candidates(sources: Sources) -> Candidates:
    """Return the combinations that the strategy of a matrix can choose from."""
    return _candidates(sources, *_all(sources))


def _all(sources: Sources) -> tuple[Axes, Contents, _SortedOut]:
    """Return the axes, the contents, and every combination, sorted into those that can be run and those that cannot."""
    matrix, expansion = sources.matrix, sources.expansion
    axes = choices(matrix, expansion, sources.host_python)
    with locate_errors(matrix.path, "axes"):
        if not matrix.strategy.listed:
            _check_size(axes)
    with locate_errors(matrix.path, "strategy"):
        _check_parts(axes, matrix.strategy.covering)
    dated = expansion and (matrix.ranges or matrix.strategy.covering)
    snapshot = matrix.snapshot or (expansion.instant if expansion and dated else None)
    contents = Contents(sources, snapshot, baseline_combinations(matrix, axes))
    return axes, contents, _sort_out(matrix, axes, contents)


def _check_size(axes: Axes) -> None:
    """Refuse, by a ValueError, axes whose product nobody could measure, before it is made."""
    count = prod(map(len, axes.values()))
    if count <= MOST:
        return
    factors = " x ".join(f"{len(listed)} {name}" for name, listed in axes.items() if len(listed) > 1)
    longest = max(axes, key=lambda name: len(axes[name]))
    message = (
        f"{amount(count)} combinations ({shorten(factors)}), at most {MOST:,} can be planned, before a strategy, an"
        f' exclude or -k selects from them; list fewer values, first of all of "{longest}", or split the matrix'
    )
    raise ValueError(message)


def _check_parts(axes: Axes, ways: int) -> None:
    """Refuse, by a ValueError, a covering array that would take for ever."""
    count = number_of_parts([len(listed) for listed in axes.values()], ways) if ways else 0
    if count > MOST_PARTS:
        message = f"{ways}-way would have {count:,} parts to cover, at most {MOST_PARTS:,} can be; choose fewer ways"
        raise ValueError(message)


def amount(count: int) -> str:
    """Write a number of things, a very large one by its power of ten."""
    # By default Python writes no integer of more than 4,300 digits.
    digits = str(count) if count < 10**4000 else ""
    return f"{count:,}" if 0 < len(digits) <= 15 else f"about 10^{len(digits) - 1}" if digits else "countless"


def shorten(text: str, most: int = 120) -> str:
    """Cut a text to `most` characters."""
    return text if len(text) <= most else f"{text[:most]} ..."


def _candidates(sources: Sources, axes: Axes, contents: Contents, sorted_out: _SortedOut) -> Candidates:
    return Candidates(
        matrix=sources.matrix,
        axes=axes,
        contents=contents,
        combinations=sorted_out.planned,
        excluded=sorted_out.dropped,
        breaks=sources.breaks,
    )


class _SortedOut:
    """Combinations by id: those to run, and those dropped with the reason; and excludes that matched nothing."""

    def __init__(self) -> None:
        self.planned: dict[str, Combination] = {}
        self.dropped: dict[str, str] = {}
        self.stale: tuple[str, ...] = ()
        self._folders: dict[str, str] = {}

    def claim(self, name: str) -> None:
        """Refuse, by a ValueError, an id that cannot be told from another one, or that is too long."""
        if len(self._folders) >= MOST:
            message = f"more than {MOST:,} combinations with those that changes make; restrict a change by its `when`"
            raise ValueError(message)
        twin = self._folders.setdefault(cellid.as_folder(name), name)
        label = CellId.parse(name).label
        if name in self.planned or name in self.dropped or twin != name:
            message = f'"{twin}" and "{name}" cannot be told apart; rename a label'
            raise ValueError(message)
        if len(label) > cellid.LONGEST:
            message = f'"{label}" has {len(label)} characters, at most {cellid.LONGEST} are allowed; shorten a label'
            raise ValueError(message)


def _sort_out(matrix: Matrix, axes: Mapping[str, tuple[Choice, ...]], contents: Contents) -> _SortedOut:
    excludes = [(condition(matrix, table.when), table.reason) for table in matrix.exclude]
    sorted_out = _SortedOut()
    matched: set[int] = set()
    with locate_errors(matrix.path, "axes"):
        for combination in () if matrix.strategy.listed else product(*axes.values()):
            name = _id(matrix, combination)
            sorted_out.claim(name)
            hits = [index for index, (when, _) in enumerate(excludes) if when.holds(combination)]
            matched.update(hits)
            if hits:
                sorted_out.dropped[name] = excludes[hits[0]][1]
            elif contents.cases(combination):
                sorted_out.planned[name] = combination
            else:
                sorted_out.dropped[name] = NO_CASE
    sorted_out.stale = tuple(
        f'{_file(matrix)}: exclude[{index}] matches no combination (reason: "{reason}")'
        for index, (_, reason) in enumerate(excludes)
        if index not in matched
    )
    return sorted_out


def _combination(
    matrix: Matrix, axes: Mapping[str, tuple[Choice, ...]], literals: Mapping[str, str], host_python: str
) -> Combination:
    """Return an included combination; its values need not be listed by the axes."""
    return tuple(
        next((choice for choice in listed if choice.literal == literals[name]), None)
        or choice_of(name, matrix.axes[name].kind, Value(text=literals[name]), host_python)
        for name, listed in axes.items()
    )


def _include(sorted_out: _SortedOut, matrix: Matrix, combination: Combination, contents: Contents) -> None:
    name = _id(matrix, combination)
    if name in sorted_out.planned:
        message = f'"{name}" is planned already'
        raise ValueError(message)
    if not contents.cases(combination):
        message = f'no case exists for "{name}"'
        raise ValueError(message)
    if sorted_out.dropped.pop(name, None) is None:
        sorted_out.claim(name)
    sorted_out.planned[name] = combination


def _id(matrix: Matrix, combination: Combination) -> str:
    return str(CellId.build(matrix.name, [choice.label for choice in combination]))


# --- cells -----------------------------------------------------------------------------------------------------


class _Expected(NamedTuple):
    """A compiled `expect` of the file."""

    number: int
    table: ExpectTable
    when: Condition
    expectation: Expectation

    def fits(self, cell: Cell, combination: Combination) -> bool:
        """Return whether it speaks of a cell."""
        return self.when.holds(combination) and (self.table.cells is None or cellid.fits(self.table.cells, cell))


def _cells(
    matrix: Matrix, planned: Mapping[str, Combination], contents: Contents, changing: Changing
) -> tuple[tuple[Cell, ...], tuple[str, ...]]:
    """Return the cells, each followed by its changed copies, and a line for each expectation that fits no cell."""
    expected = [
        _Expected(index, table, condition(matrix, table.when), decoding.convert(table, Expectation, attributes=True))
        for index, table in enumerate(matrix.expect)
    ]
    of_changed = [each for each in expected if each.table.of_changed]
    met: set[int] = set()
    cells = []
    for name, combination in planned.items():
        cell = Cell(
            id=name,
            matrix=matrix.name,
            axes={choice.axis: choice.text for choice in combination},
            python=next(choice.literal for choice in combination if choice.kind is Kind.PYTHON),
            question=contents.question(combination),
            cases=contents.cases(combination),
            **contents.surroundings(combination),
            subject=contents.subject(combination),
        )
        hit = next((each for each in expected if each.fits(cell, combination)), None)
        if hit:
            met.add(hit.number)
            cell = replace(cell, expect=hit.expectation)
        cells.append(cell)
        for changed in changing.of(cell, combination):
            hit = next((each for each in of_changed if each.fits(changed, combination)), None)
            if hit:
                met.add(hit.number)
            cells.append(replace(changed, expect=hit.expectation) if hit else changed)
    return tuple(cells), tuple(
        f'{_file(matrix)}: expect[{each.number}] matches no cell (reason: "{each.table.reason}")'
        for each in expected
        if each.number not in met
    )


def _variants(matrix: Matrix, planned: Mapping[str, Combination]) -> tuple[frozenset[str], tuple[str, ...]]:
    """Return the ids of the cells under a side condition, and a line for each `variant` that no cell meets."""
    cell_ids: set[str] = set()
    unmet = []
    for index, table in enumerate(matrix.variant):
        when = condition(matrix, table.when)
        hits = {name for name, combination in planned.items() if when.holds(combination)}
        cell_ids |= hits
        if not hits:
            unmet.append(f'{_file(matrix)}: variant[{index}] matches no cell (reason: "{table.reason}")')
    return frozenset(cell_ids), tuple(unmet)


def _check_subjects(sources: Sources, contents: Contents) -> None:
    """Raise BadInput if the package under test declares none of the extras and groups that a cell names."""
    project = sources.project
    if project is None:
        return
    for subject in contents.subjects.values():
        suite = subject.suite or Suite()
        _check_names(sources.matrix, "extra", (*subject.extras, *suite.extras), project.extras)
        _check_names(sources.matrix, "dependency group", (*subject.groups, *suite.groups), project.groups)


def _check_names(matrix: Matrix, what: str, names: Iterable[str], declared: Collection[str] | None) -> None:
    unknown = next((name for name in names if declared is not None and name not in declared), None)
    if unknown:
        message = f'{matrix.path}: the subject has no {what} "{unknown}"{suggestion(unknown, declared or ())}'
        raise BadInput(message)


def _file(matrix: Matrix) -> str:
    """Return the file's name for documents, which name no folders of this machine."""
    return PurePosixPath(matrix.path).name


def _unused_cases(matrix: Matrix, cells: Iterable[Cell], places: Iterable[tuple[Case, str]]) -> Iterator[str]:
    """Yield a line for each case that exists in no cell."""
    # By identity: cells share their cases, and one id may stand for different cases in different cells.
    shared = {id(cell.cases): cell.cases for cell in cells}
    used = {id(case) for cases in shared.values() for case in cases}
    for case, place in places:
        if id(case) not in used:
            yield f'{_file(matrix)}: {place} ("{case.id}") exists in no cell'

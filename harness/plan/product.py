"""The product of the axes: every combination becomes a cell, or is dropped for a reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from fnmatch import translate
from itertools import chain, product
from pathlib import PurePosixPath
from typing import NamedTuple

from harness.expansion import NO_BREAKS, Breaks
from harness.matrix import Expansion, ExpectTable, Matrix, Value
from harness.model import Case, Cell, Dropped, Expectation, Plan
from harness.plan.changing import Changing
from harness.plan.choices import Choice, Combination, Condition, as_folder, choice_of, choices, condition
from harness.plan.contents import NO_RECIPES, Contents, Recipes
from harness.plan.strategies import Axes, Candidates, baseline_combinations
from harness.schema import located
from harness.vocabulary import LONGEST_LABEL, Kind

NO_CASE = "no case exists for it"


def expand(
    matrix: Matrix,
    expansion: Expansion | None = None,
    *,
    host_python: str,
    sources: Mapping[str, str] | None = None,
    breaks: Breaks = NO_BREAKS,
    recipes: Recipes = NO_RECIPES,
) -> Plan:
    """Plan a matrix.

    `expansion` is what its ranges came to and what was chosen, where that is needed. `host_python` is the version that
    `host` stands for, `sources` the texts of `matrixfile.sources(matrix)`, `breaks` the known API breaks, `recipes` how
    packages that `overlay` names are repaired.
    """
    axes, contents, sorted_out = _all(matrix, expansion, host_python, sources or {}, recipes)
    known = _candidates(matrix, axes, contents, sorted_out, breaks)
    sorted_out.planned = known.chosen(expansion)
    for index, table in enumerate(matrix.include):
        with located(matrix.path, "include", index, "axes"):
            _include(sorted_out, matrix, _combination(matrix, axes, table.axes, host_python), contents)
    changing = Changing(matrix, contents, sorted_out.claim)
    cells, unmet = _cells(matrix, sorted_out.planned, contents, changing)
    return Plan(
        matrix=matrix.name,
        cells=cells,
        dropped=(
            *(Dropped(id=name, reason=reason) for name, reason in sorted_out.dropped.items()),
            *(Dropped(id=name, reason=reason) for name, reason in changing.dropped.items()),
            *known.left_out(sorted_out.planned, expansion),
        ),
        stale=(
            *sorted_out.stale,
            *unmet,
            *changing.stale(_file(matrix)),
            *_unused_cases(matrix, cells, contents.places(chain.from_iterable(axes.values()))),
        ),
        axes=tuple(matrix.axes),
        shown=tuple(map(str, matrix.shown)),
        snapshot=contents.snapshot,
        pivot=matrix.pivot,
        page=contents.sources[str(matrix.page)] if matrix.page else None,
    )


def candidates(
    matrix: Matrix,
    expansion: Expansion | None,
    *,
    host_python: str,
    sources: Mapping[str, str],
    breaks: Breaks = NO_BREAKS,
    recipes: Recipes = NO_RECIPES,
) -> Candidates:
    """What the strategy of a matrix has to choose from."""
    return _candidates(matrix, *_all(matrix, expansion, host_python, sources, recipes), breaks)


def _all(
    matrix: Matrix, expansion: Expansion | None, host_python: str, sources: Mapping[str, str], recipes: Recipes
) -> tuple[Axes, Contents, _SortedOut]:
    """Every combination, sorted into what can be run and what cannot."""
    axes = choices(matrix, expansion, host_python)
    dated = expansion and (matrix.ranges or matrix.strategy.covering)
    snapshot = matrix.snapshot or (expansion.instant if expansion and dated else None)
    contents = Contents(matrix, sources, snapshot, baseline_combinations(matrix, axes), recipes)
    return axes, contents, _sort_out(matrix, axes, contents)


def _candidates(matrix: Matrix, axes: Axes, contents: Contents, found: _SortedOut, breaks: Breaks) -> Candidates:
    return Candidates(
        matrix=matrix,
        axes=axes,
        contents=contents,
        combinations=found.planned,
        excluded=found.dropped,
        breaks=breaks,
    )


class _SortedOut:
    """Combinations by id: those to run, those dropped with the reason; excludes that matched nothing."""

    def __init__(self) -> None:
        self.planned: dict[str, Combination] = {}
        self.dropped: dict[str, str] = {}
        self.stale: tuple[str, ...] = ()
        self._folders: dict[str, str] = {}

    def claim(self, name: str) -> None:
        """Refuse, by a ValueError, an id that cannot be told from another one, or that is too long."""
        twin = self._folders.setdefault(as_folder(name), name)
        label = name.partition("/")[2]
        if name in self.planned or name in self.dropped or twin != name:
            message = f'"{twin}" and "{name}" cannot be told apart; rename a label'
            raise ValueError(message)
        if len(label) > LONGEST_LABEL:
            message = f'"{label}" has {len(label)} characters, at most {LONGEST_LABEL} are allowed; shorten a label'
            raise ValueError(message)


def _sort_out(matrix: Matrix, axes: Mapping[str, tuple[Choice, ...]], contents: Contents) -> _SortedOut:
    excludes = [(condition(matrix, table.when), table.reason) for table in matrix.exclude]
    found = _SortedOut()
    matched: set[int] = set()
    with located(matrix.path, "axes"):
        for combination in product(*axes.values()):
            name = _id(matrix, combination)
            found.claim(name)
            hits = [index for index, (when, _) in enumerate(excludes) if when.holds(combination)]
            matched.update(hits)
            if hits:
                found.dropped[name] = excludes[hits[0]][1]
            elif contents.cases(combination):
                found.planned[name] = combination
            else:
                found.dropped[name] = NO_CASE
    found.stale = tuple(
        f'{_file(matrix)}: exclude[{index}] matches no combination (reason: "{reason}")'
        for index, (_, reason) in enumerate(excludes)
        if index not in matched
    )
    return found


def _combination(
    matrix: Matrix, axes: Mapping[str, tuple[Choice, ...]], asked: Mapping[str, str], host_python: str
) -> Combination:
    """An included combination, of values that the axes list or of others."""
    return tuple(
        next((choice for choice in listed if choice.asked == asked[name]), None)
        or choice_of(name, matrix.axes[name].kind, Value(text=asked[name]), host_python)
        for name, listed in axes.items()
    )


def _include(found: _SortedOut, matrix: Matrix, combination: Combination, contents: Contents) -> None:
    name = _id(matrix, combination)
    if name in found.planned:
        message = f'"{name}" is planned already'
        raise ValueError(message)
    if not contents.cases(combination):
        message = f'no case exists for "{name}"'
        raise ValueError(message)
    if found.dropped.pop(name, None) is None:
        found.claim(name)
    found.planned[name] = combination


def _id(matrix: Matrix, combination: Combination) -> str:
    return f"{matrix.name}/{'-'.join([choice.label for choice in combination])}"


# --- cells -----------------------------------------------------------------------------------------------------


class _Expected(NamedTuple):
    """An `expect` of the file, compiled."""

    place: str
    glob: re.Pattern[str] | None
    when: Condition
    expectation: Expectation
    of_changed: bool

    def fits(self, name: str, label: str, combination: Combination) -> bool:
        """Whether it speaks of a cell."""
        if self.glob and not (self.glob.match(label) or self.glob.match(name)):
            return False
        return self.when.holds(combination)


def _cells(
    matrix: Matrix, planned: Mapping[str, Combination], contents: Contents, changing: Changing
) -> tuple[tuple[Cell, ...], tuple[str, ...]]:
    """The cells, what changes make of them behind each, and a line for each expectation that no cell met."""
    expected = [_expected(matrix, index, table) for index, table in enumerate(matrix.expect)]
    start = len(matrix.name) + 1
    of_changed = [each for each in expected if each.of_changed]
    met: set[str] = set()
    cells = []
    for name, combination in planned.items():
        hit = next((each for each in expected if each.fits(name, name[start:], combination)), None)
        if hit:
            met.add(hit.place)
        around = contents.surroundings(combination)
        cell = Cell(
            id=name,
            matrix=matrix.name,
            axes={choice.axis: choice.text for choice in combination},
            python=next(choice.asked for choice in combination if choice.kind is Kind.PYTHON),
            question=contents.question(combination),
            environment=around.environment,
            cases=contents.cases(combination),
            needs=around.needs,
            system=around.system,
            files=around.files,
            empty=around.empty,
            python_path=around.python_path,
            bring=around.bring,
            expect=hit.expectation if hit else None,
            subject=contents.subject(combination),
        )
        cells.append(cell)
        for changed in changing.of(cell, combination):
            hit = next((each for each in of_changed if each.fits(changed.id, changed.label, combination)), None)
            if hit:
                met.add(hit.place)
            cells.append(replace(changed, expect=hit.expectation) if hit else changed)
    unmet = (each for each in expected if each.place not in met)
    return tuple(cells), tuple(f'{each.place} matches no cell (reason: "{each.expectation.reason}")' for each in unmet)


def _expected(matrix: Matrix, index: int, table: ExpectTable) -> _Expected:
    return _Expected(
        place=f"{_file(matrix)}: expect[{index}]",
        glob=re.compile(translate(table.cells)) if table.cells is not None else None,
        when=condition(matrix, table.when),
        of_changed=table.of_changed,
        expectation=Expectation(
            verdict=table.verdict,
            reason=table.reason,
            phase=table.phase,
            match=str(table.match) if table.match else None,
            signature=table.signature,
            link=table.link,
            until=str(table.until) if table.until else None,
        ),
    )


def _file(matrix: Matrix) -> str:
    """How documents, which name no folders of this machine, call the file."""
    return PurePosixPath(matrix.path).name


def _unused_cases(matrix: Matrix, cells: Iterable[Cell], places: Iterable[tuple[Case, str]]) -> Iterator[str]:
    """A line for each case that exists in no cell."""
    shared = {id(cell.cases): cell.cases for cell in cells}
    used = {id(case) for cases in shared.values() for case in cases}
    for case, place in places:
        if id(case) not in used:
            yield f'{_file(matrix)}: {place} ("{case.id}") exists in no cell'

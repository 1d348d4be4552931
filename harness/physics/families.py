"""Group cells into behaviour families for one case, and find the boundaries between neighbouring releases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from string import ascii_uppercase

from msgspec import Struct
from packaging.version import InvalidVersion, Version

from harness.physics.relation import STARTS, Class, Comparison

Compare = Callable[[str, str], Comparison]
"""Compares two cells, named by their ids."""


class Boundary(Struct, frozen=True, kw_only=True):
    """Two neighbouring cells along an axis that do not behave, or do not start, alike.

    `moved` maps each package whose version differs in their locks to both versions: if it is the axis alone, the
    boundary is that package's. `between` are values of the axis between the two that were not measured.
    """

    axis: str
    before: str
    after: str
    cells: tuple[str, str]
    comparison: Comparison
    moved: Mapping[str, tuple[str | None, str | None]]
    between: tuple[str, ...] = ()

    @property
    def package(self) -> str:
        """Return the package that the boundary belongs to: the only one that moved, else the axis."""
        return next(iter(self.moved)) if len(self.moved) == 1 else self.axis

    @property
    def others(self) -> Mapping[str, tuple[str | None, str | None]]:
        """Return the packages that moved besides, from which the boundary is not separated."""
        return {name: versions for name, versions in self.moved.items() if name != self.package}


def families(cells: Sequence[str], compare: Compare) -> dict[str, str]:
    """Return the letters of each cell's families, in the order of the cells.

    A cell joins a family if it agrees with all its members; one that agrees with several has several letters. A prime
    marks a cell that agrees with some member only to the precision of the solver. A question mark marks one of which it
    cannot be decided whether it agrees. Neither counts as a member.
    """
    members: list[list[str]] = []
    letters: dict[str, str] = {}
    for cell in cells:
        fitting = [number for number, family in enumerate(members) if all(compare(cell, one).agrees for one in family)]
        doubtful = [] if fitting else [n for n, family in enumerate(members) if _may_agree(cell, family, compare)]
        if doubtful:
            letters[cell] = letter(doubtful[0]) + "?"
            continue
        if not fitting:
            members.append([])
            fitting = [len(members) - 1]
        primed = any(compare(cell, one).kind is Class.SOLVER_PRECISION for number in fitting for one in members[number])
        letters[cell] = "".join(map(letter, fitting)) + "'" * primed
        if not primed:
            for number in fitting:
                members[number].append(cell)
    return letters


def _may_agree(cell: str, family: Sequence[str], compare: Compare) -> bool:
    """Return whether nothing shows that a cell differs from a member of a family."""
    return all(compare(cell, one).agrees or compare(cell, one).kind is Class.UNDECIDED for one in family)


def letter(number: int) -> str:
    """Return the name of a family: A to Z, then A1 and so on."""
    round_, place = divmod(number, len(ascii_uppercase))
    return ascii_uppercase[place] + (str(round_) if round_ else "")


def boundaries(
    axis: str,
    values: Sequence[str],
    cells: Mapping[str, str],
    installed: Mapping[str, Mapping[str, str]],
    compare: Compare,
) -> list[Boundary]:
    """Return the boundaries along an axis.

    Args:
        axis: The package whose releases are the values.
        values: All values of the axis, in their order.
        cells: The measured cell of each value.
        installed: Versions by package, for each cell.
        compare: Compares two cells.
    """
    measured = [value for value in values if value in cells]
    result = []
    for before, after in pairwise(measured):
        pair = cells[before], cells[after]
        comparison = compare(*pair)
        if not comparison.agrees or comparison.start in STARTS:
            places = values.index(before), values.index(after)
            result.append(
                Boundary(
                    axis=axis,
                    before=before,
                    after=after,
                    cells=pair,
                    comparison=comparison,
                    moved=moved_packages(installed[pair[0]], installed[pair[1]]),
                    between=tuple(values[places[0] + 1 : places[1]]),
                )
            )
    return result


def release_order(value: str) -> tuple[str, int, Version | str]:
    """Return a sort key for a value of an axis: a release (`1.10.0`), or one with its package (`gym-0.26.2`)."""
    package, dash, release = value.rpartition("-")
    try:
        return package, 1, Version(release)
    except InvalidVersion:
        return value if dash else "", 0, value


def moved_packages(first: Mapping[str, str], second: Mapping[str, str]) -> dict[str, tuple[str | None, str | None]]:
    """Return the packages whose versions differ between two locks, with both versions."""
    names = sorted(first.keys() | second.keys())
    return {name: (first.get(name), second.get(name)) for name in names if first.get(name) != second.get(name)}

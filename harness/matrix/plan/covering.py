"""Make covering arrays: few rows of many, in which every combination of values of a few axes still occurs.

A row is a tuple of positions, one for each axis. `covertable` finds the rows; ours is the rule of what is allowed: a
row that is not complete yet is kept only while some allowed row completes it, so that no search ends in a dead end
and whatever can be covered is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product

Row = tuple[int, ...]
Part = tuple[tuple[int, int], ...]
"""Some axes of a row, each with its value."""


def covering(
    allowed: Sequence[Row], ways: int, *, given: Sequence[Row] = (), preferred: Sequence[Row] = ()
) -> list[Row]:
    """Choose allowed rows with every part of `ways` axes that the allowed rows have; the same rows every time.

    The result includes the rows in `given`. Rows in `preferred` are taken before others, as far as they are needed.
    """
    from covertable import Controller  # type: ignore[import-untyped]  # noqa: PLC0415 - for `lock`, not every start

    if not allowed:
        return []
    # Sets of rows are bits of one integer, and -1 has every row: covertable asks for each value that it tries.
    having: dict[tuple[int, int], int] = {}
    for number, row in enumerate(allowed):
        for place in enumerate(row):
            having[place] = having.get(place, 0) | 1 << number
    width = len(allowed[0])

    def completes(partial: dict[int, int]) -> bool | None:
        left = -1
        for place in partial.items():
            left &= having.get(place, 0)
        # None means undecided: after a True covertable would not ask again as the row grows.
        return None if left and len(partial) < width else bool(left)

    controller = Controller(
        [list(range(1 + max(row[axis] for row in allowed))) for axis in range(width)],
        strength=ways,
        constraints=[{"operator": "fn", "requires": (), "evaluate": completes}],
        presets=[list(row) for row in (*given, *preferred)],
    )
    # covertable keeps every preset, needed or not. `make_async` is a plain generator, whatever its name says.
    return _needed([tuple(row) for row in controller.make_async()], ways, set(given))


def parts(row: Row, ways: int) -> Iterator[Part]:
    """Yield every part of a row that has this many axes."""
    return combinations(tuple(enumerate(row)), ways)


def number_of_parts(sizes: Sequence[int], ways: int) -> int:
    """Count the possible parts of `ways` axes, given the sizes of all axes."""
    counts = [1, *[0] * ways]
    for size in sizes:
        counts = [1, *(there + size * less for there, less in zip(counts[1:], counts, strict=False))]
    return counts[ways]


def uncovered_parts(rows: Iterable[Row], sizes: Sequence[int], ways: int) -> list[Part]:
    """Return the parts of at most `ways` axes that no row has; parts that contain a listed one are left out."""
    chosen = list(rows)
    missing: list[Part] = []
    smaller: set[Part] = set()
    for number in range(1, ways + 1):
        there = {part for row in chosen for part in parts(row, number)}
        for axes in combinations(range(len(sizes)), number):
            for values in product(*(range(sizes[axis]) for axis in axes)):
                part = tuple(zip(axes, values, strict=True))
                if part not in there and not any(piece in smaller for piece in _pieces(part)):
                    missing.append(part)
        smaller.update(missing)
    return missing


def _pieces(part: Part) -> Iterator[Part]:
    return (piece for size in range(1, len(part)) for piece in combinations(part, size))


def _needed(rows: list[Row], ways: int, given: set[Row]) -> list[Row]:
    """Return the rows, dropping each (unless given) whose every part is in other rows as well."""
    times = Counter(part for row in rows for part in parts(row, ways))
    needed = []
    for row in rows:
        own = list(parts(row, ways))
        if row in given or any(times[part] == 1 for part in own):
            needed.append(row)
        else:
            times.subtract(own)
    return needed

"""Apply a strategy to all combinations: choose some, and say what is left out and what no cell has.

`baseline` and `boundaries` follow from the matrix alone. A covering array is made once, when the matrix is locked
(`choosing`), and committed with the expansion.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
from packaging.version import Version

from harness.matrix.matrix_types import NO_CHANGES, Chosen, Expansion, Matrix, MatrixTable
from harness.matrix.plan.choices import Choice, Combination
from harness.matrix.plan.contents import Contents
from harness.matrix.plan.covering import Part, Row, uncovered_parts
from harness.matrix.version_ranges import Breaks, boundaries
from harness.model import Dropped
from harness.model.cellid import CellId
from harness.model.schema import locate_errors, suggestion
from harness.model.vocabulary import ABSENT, Kind

Axes = Mapping[str, tuple[Choice, ...]]
WITHOUT_WEIGHT = {
    *("axes", "bring", "cases", "change", "description", "empty", "environment", "exclude", "expect", "files"),
    *("include", "needs", "page", "pivot", "python_path", "shown", "suite", "system"),
}
"""Keys that have no say in what resolves; the axes and the combinations that exist are looked into."""


# --- chosen by what the file says ------------------------------------------------------------------------------


def baseline_combinations(matrix: Matrix, axes: Axes) -> frozenset[Combination]:
    """Return the baselines of the strategy, and the combinations that differ from one in one axis."""
    combinations: set[Combination] = set()
    for named in matrix.strategy.baselines:
        base = _baseline(matrix, axes, named)
        for position, choices in enumerate(axes.values()):
            combinations.update((*base[:position], choice, *base[position + 1 :]) for choice in choices)
    return frozenset(combinations)


def _baseline(matrix: Matrix, axes: Axes, named: Mapping[str, str]) -> Combination:
    return tuple(
        _named(matrix, choices, named[name]) if name in named else _default(choices) for name, choices in axes.items()
    )


def _named(matrix: Matrix, choices: Sequence[Choice], literal: str) -> Choice:
    with locate_errors(matrix.path, "strategy", "baseline", choices[0].axis):
        for choice in choices:
            if choice.literal == literal:
                return choice
        message = f'the axis has no value "{literal}"{suggestion(literal, [choice.literal for choice in choices])}'
        raise ValueError(message)


def _default(choices: Sequence[Choice]) -> Choice:
    """Return the newest version; for names and variables, the first value."""
    versions = [choice for choice in choices if choice.kind in {Kind.PYTHON, Kind.PACKAGE} and choice.text != ABSENT]
    return max(versions, key=lambda choice: Version(choice.text)) if versions else choices[0]


def _at_boundaries(axes: Axes, breaks: Breaks) -> Callable[[Combination], bool]:
    """Return a test: has each package of a combination the newest patch of a minor, or is it at an API break?"""
    allowed: set[Choice] = set()
    for name, choices in axes.items():
        versions = {choice.text: choice for choice in choices if choice.text != ABSENT}
        if choices[0].kind is Kind.PACKAGE:
            wanted = boundaries(map(Version, versions), breaks.get(name, ()))
            allowed.update(choice for text, choice in versions.items() if Version(text) in wanted)
            allowed.update(choice for choice in choices if choice.text == ABSENT)
        else:
            allowed.update(choices)
    return allowed.issuperset


# --- all together ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """The combinations that a strategy chooses from, by id; `excluded` were left out before, each with the reason."""

    matrix: Matrix
    axes: Axes
    contents: Contents
    combinations: Mapping[str, Combination]
    excluded: Mapping[str, str]
    breaks: Breaks

    @cached_property
    def named(self) -> dict[str, Combination]:
        """Return the combinations that `baseline` and `boundaries` choose, by id."""
        strategy = self.matrix.strategy
        baseline = baseline_combinations(self.matrix, self.axes)
        at_boundary = _at_boundaries(self.axes, self.breaks) if strategy.boundaries else lambda _: False
        return {
            name: combination
            for name, combination in self.combinations.items()
            if combination in baseline or at_boundary(combination)
        }

    @cached_property
    def places(self) -> dict[Choice, int]:
        """Return the position of each value in its axis."""
        return {choice: position for choices in self.axes.values() for position, choice in enumerate(choices)}

    @property
    def made_from(self) -> str:
        """Return a hash of all that decides a covering array's combinations, except the index."""
        inputs: dict[str, Any] = {
            "axes": {
                name: [(choice.literal, weight(choice.changes, NO_CHANGES)) for choice in choices]
                for name, choices in self.axes.items()
            },
            "combinations": [self.row(each) for each in self.combinations.values()],
            "named": [self.row(each) for each in self.named.values()],
            "matrix": weight(self.matrix, MatrixTable(axes={})),
        }
        return hashlib.sha256(msgspec.json.encode(inputs, enc_hook=_plain, order="deterministic")).hexdigest()

    def row(self, combination: Combination) -> Row:
        """Return a combination as positions in its axes."""
        return tuple(self.places[choice] for choice in combination)

    def combination(self, row: Row) -> Combination:
        """Return the values at the positions of a row."""
        return tuple(choices[position] for position, choices in zip(row, self.axes.values(), strict=True))

    @cached_property
    def names(self) -> dict[tuple[str, ...], str]:
        """Return the id of each combination, by its values as the file writes them."""
        return {tuple(choice.literal for choice in each): name for name, each in self.combinations.items()}

    def chosen(self, expansion: Expansion | None) -> dict[str, Combination]:
        """Return the combinations that the strategy chooses; a covering array is taken from the expansion.

        With a covering array, combinations known not to resolve are left out, whatever other strategy chooses them.
        """
        strategy = self.matrix.strategy
        if strategy.full:
            return dict(self.combinations)
        with locate_errors(self.matrix.path, "strategy"):
            self.check()
            if not strategy.covering:
                return self.named
            selection = self._covering(expansion)
        covering = {self.names[values] for values in selection.combinations}
        return {
            name: each
            for name, each in self.combinations.items()
            if name in covering or (name in self.named and not any(_has(each, e.axes) for e in selection.unresolvable))
        }

    def check(self) -> None:
        """Refuse, by a ValueError, a strategy that this matrix cannot have."""
        ways = self.matrix.strategy.covering
        if ways > len(self.axes):
            message = f"{ways}-way needs {ways} axes, the matrix has {len(self.axes)}"
            raise ValueError(message)
        labels = {tuple(each): name for name, each in self.combinations.items()}
        for named in self.matrix.strategy.baselines:
            base = _baseline(self.matrix, self.axes, named)
            if base not in labels:
                cell_id = CellId.build(self.matrix.name, [choice.label for choice in base])
                why = self.excluded[str(cell_id)]
                message = (
                    f'the baseline "{cell_id.label}" is left out ({why}); name another: {{ baseline = {{ ... }} }}'
                )
                raise ValueError(message)

    def _covering(self, expansion: Expansion | None) -> Chosen:
        file = self.matrix.path
        if expansion is None or not isinstance(expansion.chosen, Chosen):
            message = f'the combinations are not chosen yet; run "simmatrix lock {file}"'
            raise ValueError(message)
        if not self.fits(expansion):
            message = f'the matrix has changed since they were chosen; run "simmatrix lock {file} --upgrade"'
            raise ValueError(message)
        return expansion.chosen

    def fits(self, expansion: Expansion) -> bool:
        """Return whether the choice was made from the matrix as it is now."""
        chosen = expansion.chosen
        if not isinstance(chosen, Chosen) or chosen.made_from != self.made_from or not expansion.fits(self.matrix):
            return False
        # `made_from` does not see what somebody wrote into the committed file.
        axis_values = {(name, choice.literal) for name, choices in self.axes.items() for choice in choices}
        return self.names.keys() >= set(chosen.combinations) and all(
            axis_values >= set(entry.axes.items()) for entry in chosen.unresolvable
        )

    def left_out(self, chosen: Mapping[str, Combination], expansion: Expansion | None) -> Iterator[Dropped]:
        """Yield what the strategy leaves out, summed up in a few entries."""
        rest = {name: each for name, each in self.combinations.items() if name not in chosen}
        selection = expansion.chosen if expansion and self.matrix.strategy.covering else None
        for entry in selection.unresolvable if isinstance(selection, Chosen) else ():
            gone = [name for name, each in rest.items() if _has(each, entry.axes)]
            for name in gone:
                del rest[name]
            parts = (
                next(choice.label for choice in choices if choice.literal == entry.axes[name])
                if name in entry.axes
                else "*"
                for name, choices in self.axes.items()
            )
            if gone:
                reason = f"does not resolve: {entry.reason}"
                yield Dropped(id=str(CellId.build(self.matrix.name, parts)), reason=reason, count=len(gone))
        if rest:
            listed = [each for name, each in self.combinations.items() if name in chosen]
            yield Dropped(id=f"{self.matrix.name}/*", reason=self._unchosen(listed), count=len(rest))

    def _unchosen(self, chosen: Iterable[Combination]) -> str:
        strategy = self.matrix.strategy
        reason = f"not chosen by {' and '.join(strategy.names)}"
        if not strategy.covering:
            return reason
        every = {1: "value", 2: "pair of values"}.get(strategy.ways, f"combination of {strategy.ways} values")
        rows = [self.row(each) for each in chosen]
        missing = uncovered_parts(rows, [len(choices) for choices in self.axes.values()], strategy.ways)
        return f"{reason}; each {every} is in some cell{self._but(missing)}"

    def _but(self, missing: Sequence[Part]) -> str:
        """List the values that are together in no cell; parts that differ only in the last value share a phrase."""
        names = list(self.axes)
        phrases: dict[tuple[str, str], list[str]] = {}
        for part in missing:
            *first, last = [(names[axis], self.axes[names[axis]][place].text or "unset") for axis, place in part]
            head = " and ".join(f"{name} {text}" for name, text in first)
            phrases.setdefault((head, last[0]), []).append(last[1])
        clauses = [
            f"{head} with " * bool(head) + f"{name} {', '.join(texts)}" for (head, name), texts in phrases.items()
        ]
        return f", but for these, excluded or without a resolution: {'; '.join(clauses)}" if clauses else ""


def _has(combination: Combination, values: Mapping[str, str]) -> bool:
    return all(values.get(choice.axis, choice.literal) == choice.literal for choice in combination)


def weight(table: msgspec.Struct, empty: msgspec.Struct = NO_CHANGES) -> dict[str, Any]:
    """Return the keys of a table that affect resolution and differ from those of an empty table.

    A key that a later version of the harness knows, and the file does not have, changes nothing.
    """
    names = [name for name in type(empty).__struct_fields__ if name not in WITHOUT_WEIGHT]
    return {name: getattr(table, name) for name in names if getattr(table, name) != getattr(empty, name)}


def _plain(value: Any) -> Any:
    """Convert what msgspec does not know: objects with slots."""
    return {name: getattr(value, name) for name in value.__slots__}

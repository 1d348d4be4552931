"""Make the values of the axes as cells name them, and compile the conditions on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from harness.matrix.matrix_types import NO_CHANGES, Axis, CaseTable, Changes, Expansion, Matrix, Value
from harness.model import cellid
from harness.model.schema import locate_errors
from harness.model.vocabulary import HOST, NONE, UNSET, Kind, Label, When, alternatives, matcher


# Compared by identity (`eq=False`): its tables hold dictionaries, so that they have no hash by value.
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Choice:
    """One value of one axis. `literal` is how the file writes it, `text` how cells name it, `label` its part of ids."""

    axis: str
    kind: Kind
    literal: str
    text: str
    label: str
    changes: Changes = NO_CHANGES
    cases: tuple[CaseTable, ...] = ()


Combination = tuple[Choice, ...]


def _values(matrix: Matrix, name: str, axis: Axis, expansion: Expansion | None) -> tuple[Value, ...]:
    if axis.range is None:
        return axis.values
    with locate_errors(matrix.path, "axes", name):
        if expansion is None:
            message = f'the range is not expanded yet; run "simmatrix lock {matrix.path}"'
            raise ValueError(message)
        if not expansion.fits(matrix):
            message = f'the range has changed since it was expanded; run "simmatrix lock {matrix.path} --upgrade"'
            raise ValueError(message)
    return tuple(Value(text=version) for version in expansion.axes[name])


def choices(matrix: Matrix, expansion: Expansion | None, host: str) -> dict[str, tuple[Choice, ...]]:
    """Return every axis with its values in order; `host` is the version that the Python `host` stands for."""
    values = {name: _values(matrix, name, axis, expansion) for name, axis in matrix.axes.items()}
    return {name: _distinct_choices(matrix, name, each, host) for name, each in values.items()}


def _distinct_choices(matrix: Matrix, name: str, values: Iterable[Value], host: str) -> tuple[Choice, ...]:
    with locate_errors(matrix.path, "axes", name):
        axis_choices = tuple(choice_of(name, matrix.axes[name].kind, value, host) for value in values)
        by_folder: dict[str, Choice] = {}
        for choice in axis_choices:
            twin = by_folder.setdefault(cellid.as_folder(choice.label), choice)
            if twin is not choice:
                message = f'"{twin.literal}" and "{choice.literal}" cannot be told apart: both are "{choice.label}"'
                raise ValueError(message)
    return axis_choices


def choice_of(name: str, kind: Kind, value: Value, host: str) -> Choice:
    """Return one value of one axis. Raises ValueError if ids cannot name it."""
    literal = value.text
    match kind:
        case Kind.PYTHON:
            text = host if literal == HOST else literal
            label = f"py{text}"
        case Kind.PACKAGE:
            text = literal
            label = cellid.package(name, literal)
        case Kind.BUNDLE | Kind.VARIABLE:
            text = literal or UNSET
            label = cellid.spell(text)
        case Kind.EXTRA | Kind.GROUP:
            text, label = literal or NONE, cellid.spell(literal) or f"no-{kind}"
    Label.canonical(text)
    return Choice(
        axis=name, kind=kind, literal=literal, text=text, label=label, changes=value.changes, cases=value.cases
    )


class Condition(NamedTuple):
    """A compiled `when`: for each axis, its position in a combination and tests of which one must hold."""

    tests: tuple[tuple[int, tuple[Callable[[str], bool], ...]], ...]

    def holds(self, combination: Combination) -> bool:
        """Return whether every axis agrees."""
        return all(any(test(combination[at].text) for test in tests) for at, tests in self.tests)


def condition(matrix: Matrix, when: When) -> Condition:
    """Compile a `when` of the file."""
    positions = {name: position for position, name in enumerate(matrix.axes)}
    return Condition(
        tuple(
            (positions[name], tuple(matcher(matrix.axes[name].kind, each) for each in alternatives(patterns)))
            for name, patterns in when.items()
        )
    )

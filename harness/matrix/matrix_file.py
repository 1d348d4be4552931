"""Read matrix files: TOML text to a `Matrix`.

What the types cannot say is checked here: names that must exist elsewhere in the file, versions in their normalised
form, keys that exclude one another. Everything is pure; `sources` names the files that the caller has to read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import PurePosixPath
from typing import Any

import msgspec
from packaging.utils import canonicalize_name

from harness.matrix.matrix_types import (
    CONDITIONAL,
    Axis,
    CaseTable,
    Changes,
    ChangeTable,
    IncludeTable,
    Matrix,
    MatrixTable,
    SourceTable,
    Value,
)
from harness.matrix.policies import SCRIPTED
from harness.matrix.strategy import Strategy
from harness.model import CELL_PHASES, Expectation, Phase, Verdict
from harness.model.errors import BadInput
from harness.model.schema import key_path, load_toml, locate_errors, suggestion
from harness.model.vocabulary import (
    ABSENT,
    APIS,
    CHECKS,
    HOST,
    IMPORT_CHECK,
    NAMED,
    NONE,
    OF_SUBJECT,
    UNSET,
    Kind,
    Label,
    SubjectNames,
    When,
    alternatives,
    api_of,
    case_id,
    check_specifier,
    check_variable,
    checks_of,
    matcher,
    parsed_requirement,
    version_text,
)
from harness.model.words import refusal

EXPECTABLE = frozenset(Verdict) - {Verdict.NOT_RUN, Verdict.INCONCLUSIVE, Verdict.UNAVAILABLE}
"""Verdicts about packages; the others are about this machine, and no cell can be expected to be them."""

WHICH = 'say which cells: a glob as "cells", or a "when"'
DOING = tuple(name for name in (*Changes.__struct_fields__, "python", "as_of", "uninstall"))
"""Keys by which a change does something."""

Keys = tuple[str | int, ...]


def read(text: str, path: str) -> Matrix:
    """Read a matrix file; `path` gives the matrix its name and stands in messages."""
    table = load_toml(text, MatrixTable, path)
    name = PurePosixPath(path).stem
    with locate_errors(path):
        Label.canonical(name)
    axes = {axis: _named(path, axis, written) for axis, written in table.axes.items()}
    fields = {field: getattr(table, field) for field in table.__struct_fields__}
    matrix = Matrix(**{**fields, "axes": axes, "name": name, "path": path})
    _check(matrix)
    matrix = msgspec.structs.replace(matrix, strategy=_strategy(matrix))
    included = tuple(_included(matrix, index, table) for index, table in enumerate(matrix.include))
    return msgspec.structs.replace(matrix, include=included)


def sources(matrix: Matrix) -> dict[str, str]:
    """Return the texts that `files` and `page` read: each path, relative to the matrix file's folder, and who asks."""
    page: dict[str, str] = {matrix.page: f"{matrix.path}: page"} if matrix.page else {}
    return page | {
        content.source: f"{matrix.path}: {key_path(*place, 'files', name, 'source')}"
        for place, changes in _changes(matrix)
        for name, content in changes.files.items()
        if isinstance(content, SourceTable)
    }


def banks(matrix: Matrix) -> dict[str, str]:
    """Return the banks of states that cases name: each path, relative to the matrix file's folder, and who asks."""
    return {table.bank: f"{place}.bank" for place, table in _case_tables(matrix) if table.bank}


def policies(matrix: Matrix) -> dict[str, str]:
    """Return the files of policies that cases name: each path, relative to the matrix file's folder, and who asks."""
    named = {table.policy: f"{place}.policy" for place, table in _case_tables(matrix) if table.policy}
    return {path: place for path, place in named.items() if path != SCRIPTED}


def _case_tables(matrix: Matrix) -> list[tuple[str, CaseTable]]:
    """Return the tables of cases, each with its place."""
    tables = [(f"{matrix.path}: cases[{index}]", table) for index, table in enumerate(matrix.cases)]
    return tables + [
        (f"{matrix.path}: {key_path('axes', axis, value.text, 'cases')}[{index}]", table)
        for axis, read_axis in matrix.axes.items()
        for value in read_axis.values
        for index, table in enumerate(value.cases)
    ]


def repairing(matrix: Matrix) -> bool:
    """Return whether some of its cells take repaired releases."""
    return any(changes.overlay for _, changes in _changes(matrix))


# --- axes ------------------------------------------------------------------------------------------------------


def _named(file: str, name: str, axis: Axis) -> Axis:
    """Return the axis with the kind that its name implies (Python or package), and its versions normalised."""
    kind = Kind.PYTHON if name == Kind.PYTHON else axis.kind
    with locate_errors(file, "axes", name):
        _check_name(name, axis)
    values: dict[str, Value] = {}
    for index, value in enumerate(axis.values):
        segment = _segment(kind, value, index)
        with locate_errors(file, "axes", name, *segment):
            text = value_text(kind, value.text)
            if text in values:
                message = f'"{text}" is listed twice'
                raise ValueError(message)
        values[text] = msgspec.structs.replace(value, text=text)
    return Axis(kind, tuple(values.values()), axis.range)


def _segment(kind: Kind, value: Value, index: int) -> Keys:
    """Return the keys of a value within its axis, for messages."""
    match kind:
        case Kind.BUNDLE:
            return (value.text,)
        case Kind.VARIABLE | Kind.EXTRA | Kind.GROUP:
            return (kind.value, index)
        case _:
            return (index,)


def _check_name(name: str, axis: Axis) -> None:
    message = None
    if name == Kind.PYTHON and (axis.kind is not Kind.PACKAGE or axis.range):
        message = 'Python is a list of versions, such as ["3.10", "3.11"]'
    elif axis.kind is Kind.PACKAGE and name != canonicalize_name(name):
        message = f'write the package by its normalised name, "{canonicalize_name(name)}"'
    if message:
        raise ValueError(message)
    if axis.kind is Kind.VARIABLE:
        check_variable(name)
    elif axis.kind in {Kind.BUNDLE, Kind.EXTRA, Kind.GROUP}:
        Label.canonical(name)
    if axis.range:
        check_specifier(axis.range.range, ">=2.3,<4")


def value_text(kind: Kind, text: str) -> str:
    """Return a value of an axis as cells name it. Raises ValueError if it cannot be one."""
    match kind:
        case Kind.PYTHON:
            return text if text == HOST else version_text(text)
        case Kind.PACKAGE:
            # `latest` would be another version tomorrow, while an id names one; a range is expanded once and committed.
            if text == "latest":
                message = '"latest" is not a version; write { range = ">=0", rule = "newest" }'
                raise ValueError(message)
            return text if text == ABSENT else version_text(text)
        case Kind.BUNDLE:
            return Label.canonical(text)
        case Kind.VARIABLE:
            return Label.canonical(text) if text else text
        case Kind.EXTRA | Kind.GROUP:
            return "" if text == NONE else SubjectNames.canonical(text)


# --- checks across the file ------------------------------------------------------------------------------------


def _check(matrix: Matrix) -> None:
    if Kind.PYTHON not in matrix.axes:
        message = f'{matrix.path}: axes: there is no Python; write for instance python = ["3.11"]'
        raise BadInput(message)
    for path, changes in _changes(matrix):
        _check_changes(matrix, path, changes)
    _check_subject(matrix)
    _check_pivot(matrix)
    cases = list(_cases(matrix))
    if not cases and matrix.subject is None:
        message = f"{matrix.path}: there is no case; write for instance [[cases]] with env and api"
        raise BadInput(message)
    for path, case in cases:
        _check_case(matrix.path, path, case)
    for path, when in _conditions(matrix):
        _check_when(matrix, path, when)
    for index, expected in enumerate(matrix.expect):
        with locate_errors(matrix.path, "expect", index):
            if expected.cells is None and not expected.when:
                raise ValueError(WHICH)
            _check_expect(matrix, expected)
    for index, change in enumerate(matrix.change):
        with locate_errors(matrix.path, "change", index):
            _check_change(change)
        with locate_errors(matrix.path, "change", index, "expect"):
            _check_expect(matrix, change.expect)


def _check_pivot(matrix: Matrix) -> None:
    """Refuse a pivot unless it names two different axes of the matrix."""
    for index, name in enumerate(matrix.pivot or ()):
        with locate_errors(matrix.path, "pivot", index):
            if name not in matrix.axes:
                message = f'there is no axis "{name}"{suggestion(name, matrix.axes)}'
                raise ValueError(message)
    if matrix.pivot and len(set(matrix.pivot)) < 2:
        with locate_errors(matrix.path, "pivot"):
            message = "down and across are the same axis"
            raise ValueError(message)


def _check_subject(matrix: Matrix) -> None:
    """Refuse an empty subject, and keys that need a subject where the matrix has none."""
    if matrix.subject is not None:
        with locate_errors(matrix.path, "subject"):
            if not matrix.subject.strip():
                message = 'write a folder, such as ".", a wheel, or git+ADDRESS@REFERENCE'
                raise ValueError(message)
        return
    key_paths: list[Keys] = [(*path, key) for path, changes in _changes(matrix) for key in ("extras", "groups")
                        if getattr(changes, key)]  # fmt: skip
    key_paths += [("axes", name) for name, axis in matrix.axes.items() if axis.kind in {Kind.EXTRA, Kind.GROUP}]
    key_paths += [("suite",)] if matrix.suite else []
    if key_paths:
        with locate_errors(matrix.path, *key_paths[0]):
            message = 'there is no package under test to have it; write for instance subject = "."'
            raise ValueError(message)


def _changes(matrix: Matrix) -> Iterator[tuple[Keys, Changes]]:
    """Yield every place of the file that adds to cells."""
    yield (), matrix
    for name, axis in matrix.axes.items():
        for index, value in enumerate(axis.values):
            yield ("axes", name, value.text if axis.kind is Kind.BUNDLE else index), value.changes
    yield from ((("change", index), table) for index, table in enumerate(matrix.change))


def _cases(matrix: Matrix) -> Iterator[tuple[Keys, CaseTable]]:
    yield from ((("cases", index), case) for index, case in enumerate(matrix.cases))
    for name, axis in matrix.axes.items():
        for value in axis.values:
            yield from ((("axes", name, value.text, "cases", index), case) for index, case in enumerate(value.cases))


def _conditions(matrix: Matrix) -> Iterator[tuple[Keys, When]]:
    """Yield every `when`, except those of constraints."""
    yield from ((path, case.when) for path, case in _cases(matrix))
    yield from [(("suite",), matrix.suite.when)] if matrix.suite else []
    yield from ((("exclude", index), table.when) for index, table in enumerate(matrix.exclude))
    yield from ((("variant", index), table.when) for index, table in enumerate(matrix.variant))
    yield from ((("expect", index), table.when) for index, table in enumerate(matrix.expect))
    yield from ((("change", index), table.when) for index, table in enumerate(matrix.change))


def _check_when(matrix: Matrix, path: Keys, when: When, *, locks: bool = False) -> None:
    for name, patterns in when.items():
        with locate_errors(matrix.path, *path, "when", name):
            kind = _axis(matrix, name).kind
            if locks and kind is Kind.VARIABLE:
                message = "an environment variable never changes what is installed; use a bundle axis"
                raise ValueError(message)
            for pattern in alternatives(patterns):
                holds = matcher(kind, pattern)
                if kind in NAMED:
                    _check_named(pattern, holds, _labels(matrix, name))


def _check_named(pattern: str, holds: Callable[[str], bool], labels: Sequence[str]) -> None:
    """Refuse a pattern that no value matches: in names, unlike versions, it is a mistake."""
    if not any(map(holds, labels)):
        message = f'no value of this axis is "{pattern}"{suggestion(pattern, labels)}'
        raise ValueError(message)


def _labels(matrix: Matrix, name: str) -> list[str]:
    listed = [value.text for value in matrix.axes[name].values]
    included = [table.axes[name] for table in matrix.include if name in table.axes]
    empty = NONE if matrix.axes[name].kind in OF_SUBJECT else UNSET
    return [text or empty for text in (*listed, *included)]


def _axis(matrix: Matrix, name: str) -> Axis:
    if name in matrix.axes:
        return matrix.axes[name]
    message = f"there is no such axis{suggestion(name, matrix.axes)}"
    raise ValueError(message)


def _check_changes(matrix: Matrix, path: Keys, changes: Changes) -> None:
    for key in CONDITIONAL:
        for index, constraint in enumerate(getattr(changes, key)):
            where = (*path, key, index)
            _check_when(matrix, where, constraint.when, locks=True)
            with locate_errors(matrix.path, *where):
                if parsed_requirement(constraint.require).extras and key != "overrides":
                    message = f'"{constraint.require}" has extras, which a constraint cannot have'
                    raise ValueError(message)


def _check_case(file: str, path: Keys, case: CaseTable) -> None:
    with locate_errors(file, *path):
        if case.env is None and not case.imports:
            message = 'a case needs an "env", or "imports" alone'
            raise ValueError(message)
        # A prefix that is near no API may be the module of a callable, as in `robots:make`.
        prefix = (case.env or "").rpartition(":")[0]
        if case.env is not None and api_of(case.env, case.api) is None and "did you mean" in suggestion(prefix, APIS):
            message = f'the key "api" is missing{suggestion(prefix, APIS)}'
            raise ValueError(message)
        # Called for its refusal alone: `plan/contents.py` makes the id.
        case_id(case.env, case.imports)
    checks = checks_of(case.checks) if case.env else (IMPORT_CHECK,)
    with locate_errors(file, *path, "checks"):
        if not case.env and (case.checks and checks_of(case.checks) != checks):
            message = 'without an "env" there is nothing to check but "import"'
            raise ValueError(message)
    phases = {check.partition(".")[0] for check in checks}
    with locate_errors(file, *path, "picture"):
        if case.picture and "render" not in phases:
            message = 'has no effect, since "checks" leaves "render" out'
            raise ValueError(message)
    for index, name in enumerate(case.required):
        with locate_errors(file, *path, "required", index):
            if name.partition(".")[0] not in phases:
                message = f'"{name}" has no effect, since "checks" leaves its phase out'
                raise ValueError(message)
            if name in CHECKS and name not in checks:
                message = f'"{name}" has no effect, since "checks" leaves it out'
                raise ValueError(message)
    with locate_errors(file, *path, "kwargs"):
        _check_finite(case.kwargs)
    with locate_errors(file, *path, "timeouts"):
        _check_finite(case.timeouts)


def _check_finite(plain: Any) -> None:
    """Refuse infinities and NaN: cells get their arguments and limits as JSON, which has none."""
    if isinstance(plain, float) and not math.isfinite(plain):
        message = f"{plain} cannot be handed to a cell"
        raise ValueError(message)
    for inner in plain.values() if isinstance(plain, dict) else plain if isinstance(plain, list) else ():
        _check_finite(inner)


def _check_change(change: ChangeTable) -> None:
    """Refuse a change unless it names its cells and does something: its own changes, or a remedy's."""
    does = [name for name in DOING if getattr(change, name)]
    message = None
    if change.cells is None and not change.when:
        message = WHICH
    elif change.remedy_of and does:
        message = f'it is the remedy of "{change.remedy_of}", and cannot change "{does[0]}" besides'
    elif not change.remedy_of and not does:
        message = "it changes nothing; say what, such as requirements, environment or python"
    if message:
        raise ValueError(message)


def _check_expect(matrix: Matrix, expected: Expectation) -> None:
    phases = (*CELL_PHASES, Phase.BEHAVE, Phase.INTEROP, *((Phase.SUITE,) if matrix.suite else ()))
    message = None
    if expected.verdict not in EXPECTABLE:
        message = f'"{expected.verdict}" does not test packages and cannot be expected'
    elif expected.phase is not None and expected.phase not in phases:
        message = f'no cell goes through the phase "{expected.phase}" yet'
    elif expected.match and expected.code:
        message = '"match" fits the text of a library, "code" what a check observes; write one of them'
    else:
        message = refusal(expected.code, expected.data)
    if message:
        raise ValueError(message)


def _strategy(matrix: Matrix) -> Strategy:
    """Return the strategy with versions in their normalised form."""

    def canonical(name: str, text: str) -> str:
        with locate_errors(matrix.path, "strategy", "baseline", name):
            return value_text(_axis(matrix, name).kind, text)

    for path, case in _cases(matrix):
        with locate_errors(matrix.path, *path, "only"):
            if case.only and not matrix.strategy.baselines:
                message = 'the strategy has no baseline; write strategy = "baseline", or a list with it'
                raise ValueError(message)
    return matrix.strategy.with_values(canonical)


def _included(matrix: Matrix, index: int, table: IncludeTable) -> IncludeTable:
    """Return the combination with its values in their normalised form."""
    values = {}
    for name, text in table.axes.items():
        with locate_errors(matrix.path, "include", index, "axes", name):
            axis = _axis(matrix, name)
            values[name] = value_text(axis.kind, text)
            labels = [value.text for value in axis.values]
            # A bundle's label stands for changes that only a listed one has; a version speaks for itself.
            if axis.kind is Kind.BUNDLE and text not in labels:
                message = f'unknown value "{text}"{suggestion(text, labels)}'
                raise ValueError(message)
    with locate_errors(matrix.path, "include", index, "axes"):
        if missing := [name for name in matrix.axes if name not in values]:
            message = f'the key "{missing[0]}" is missing'
            raise ValueError(message)
    return msgspec.structs.replace(table, axes=values)

"""Fill in the known failures that a matrix names: those it expects, and those whose remedies it tries as changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from harness.matrix import matrix_file
from harness.matrix.matrix_types import CONDITIONAL, ChangeTable, Constraint, Matrix
from harness.matrix.signatures import Signature
from harness.model.schema import locate_errors, suggestion


def named_failures(matrix: Matrix) -> list[tuple[matrix_file.Keys, str]]:
    """Return the ids of known failures that the matrix names, each with its place."""
    places: list[tuple[matrix_file.Keys, str | None]] = [
        (("expect", index, "signature"), one.signature) for index, one in enumerate(matrix.expect)
    ]
    for index, change in enumerate(matrix.change):
        places += [(("change", index, "remedy_of"), change.remedy_of)]
        places += [(("change", index, "expect", "signature"), change.expect.signature)]
    return [(path, name) for path, name in places if name]


def fill(matrix: Matrix, signatures: Iterable[Signature]) -> Matrix:
    """Return the matrix with its `remedy_of` changes filled in. Raises BadInput for an unknown failure."""
    ids: dict[str, Signature] = {one.id: one for one in signatures}
    for path, name in named_failures(matrix):
        with locate_errors(matrix.path, *path):
            if name not in ids:
                message = f'no signature is called "{name}"{suggestion(name, ids)}'
                raise ValueError(message)
    return msgspec.structs.replace(
        matrix, change=tuple(_remedied(matrix, index, one, ids) for index, one in enumerate(matrix.change))
    )


def _remedied(matrix: Matrix, index: int, change: ChangeTable, by_id: Mapping[str, Signature]) -> ChangeTable:
    """Return the change with the contents of its remedy filled in."""
    if change.remedy_of is None:
        return change
    remedy = by_id[change.remedy_of].remedy
    with locate_errors(matrix.path, "change", index, "remedy_of"):
        if remedy.change is None:
            message = f'no machine can apply the remedy of "{change.remedy_of}": {remedy.text}'
            raise ValueError(message)
    contents: dict[str, Any] = {name: getattr(remedy.change, name) for name in remedy.change.plain}
    for name in contents.keys() & CONDITIONAL:
        contents[name] = tuple(Constraint(text, {}) for text in contents[name])
    return msgspec.structs.replace(change, **contents)

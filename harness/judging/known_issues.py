"""Known issues by their ids, in words: symptom, cause, fix, and where they were measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import msgspec

from harness.model.errors import BadInput
from harness.model.measured import MeasuredCell
from harness.model.report_types import format_count
from harness.standalone.failures.remedies import in_words

if TYPE_CHECKING:
    from harness.matrix.signatures import Signature

SHOWN = 5


class Issue(msgspec.Struct, frozen=True, kw_only=True):
    """A known issue: `packages` take part in it, `silent` means that nothing is raised, `cells` have it.

    `formerly` are ids that it had before.
    """

    id: str
    cause: str
    remedy: dict[str, Any]
    fix: str
    silent: bool
    packages: tuple[str, ...]
    example: str | None
    references: tuple[str, ...]
    formerly: tuple[str, ...] = ()
    cells: tuple[str, ...] = ()


def from_signature(signature: Signature) -> Issue:
    """Return a known issue as documents have it, without its cells."""
    return Issue(
        id=signature.id,
        cause=signature.cause,
        remedy=signature.remedy.plain,
        fix=in_words(signature.remedy.plain),
        silent=signature.silent,
        packages=tuple(each for part in signature.packages for each in part),
        example=next(iter(signature.examples), None),
        references=signature.references,
        formerly=signature.formerly,
    )


def find(identifier: str, issues: Iterable[Issue], cells: Iterable[MeasuredCell]) -> Issue:
    """Return the known issue of an id, with or without `silent:` before it. Raises BadInput."""
    there = tuple(issues)
    issue = lookup(identifier, there)
    if issue:
        return with_cells([issue], cells)[0]
    near = get_close_matches(identifier.removeprefix("silent:"), [one.id for one in there], n=1)
    hint = f"did you mean {near[0]}?" if near else "`simmatrix known` lists them"
    message = f"{identifier}: no known issue has this id; {hint}"
    raise BadInput(message)


def lookup(identifier: str, issues: Iterable[Issue]) -> Issue | None:
    """Return the issue that has this id, or had it before; None where there is none."""
    name = identifier.removeprefix("silent:")
    return next((one for one in issues if name in {one.id, *one.formerly}), None)


def with_cells(issues: Iterable[Issue], cells: Iterable[MeasuredCell]) -> list[Issue]:
    """Return known issues with the measured cells that have them."""
    held: dict[str, list[str]] = {}
    for cell in cells:
        for name in (*cell.causes, *(text.removeprefix("silent:") for text in cell.unverified)):
            held.setdefault(name, []).append(cell.id)
    return [msgspec.structs.replace(one, cells=tuple(dict.fromkeys(held.get(one.id, ())))) for one in issues]


def lines(issue: Issue) -> Iterator[str]:
    """Yield a known issue in words."""
    yield issue.id
    if issue.example:
        yield f"  symptom    {issue.example.strip().splitlines()[-1]}"
    if issue.silent:
        yield "  symptom    none: nothing is raised, and the result is wrong"
    yield f"  cause      {issue.cause}"
    yield f"  fix        {issue.fix}"
    if issue.packages:
        yield f"  concerns   {', '.join(issue.packages)}"
    yield from (f"  reference  {reference}" for reference in issue.references)
    yield (
        f"  measured   in {format_count(len(issue.cells), 'cell')}"
        if issue.cells
        else "  measured   in no cell that came with this version"
    )
    yield from (f"  simmatrix show {cell}" for cell in issue.cells[:SHOWN])

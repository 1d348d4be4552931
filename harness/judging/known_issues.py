"""Known issues by their ids, in words: symptom, cause, fix, and where they were measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import msgspec

from harness.model.errors import BadInput
from harness.model.report_types import number
from harness.standalone.remedies import in_words

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


def of(one: Signature) -> Issue:
    """Return a known issue as documents have it, without its cells."""
    return Issue(
        id=str(one.id),
        cause=one.cause,
        remedy=one.remedy.plain,
        fix=in_words(one.remedy.plain),
        silent=one.silent,
        packages=tuple(str(each) for part in one.packages for each in part.requirements),
        example=next(iter(one.examples), None),
        references=one.references,
        formerly=tuple(map(str, one.formerly)),
    )


def find(identifier: str, issues: Iterable[Issue], cells: Iterable[Mapping[str, Any]]) -> Issue:
    """Return the known issue of an id, with or without `silent:` before it. Raises BadInput."""
    there = tuple(issues)
    found = named(identifier, there)
    if found:
        return with_cells([found], cells)[0]
    near = get_close_matches(identifier.removeprefix("silent:"), [one.id for one in there], n=1)
    hint = f"did you mean {near[0]}?" if near else "`simmatrix known` lists them"
    message = f"{identifier}: no known issue has this id; {hint}"
    raise BadInput(message)


def named(identifier: str, issues: Iterable[Issue]) -> Issue | None:
    """Return the issue that has this id, or had it before; None where there is none."""
    name = identifier.removeprefix("silent:")
    return next((one for one in issues if name in {one.id, *one.formerly}), None)


def with_cells(issues: Iterable[Issue], cells: Iterable[Mapping[str, Any]]) -> list[Issue]:
    """Return known issues with the measured cells that have them."""
    held: dict[str, list[str]] = {}
    for cell in cells:
        for name in (*cell["causes"], *(text.removeprefix("silent:") for text in cell["unverified"])):
            held.setdefault(name, []).append(cell["id"])
    return [msgspec.structs.replace(one, cells=tuple(dict.fromkeys(held.get(one.id, ())))) for one in issues]


def lines(one: Issue) -> Iterator[str]:
    """Yield a known issue in words."""
    yield one.id
    if one.example:
        yield f"  symptom    {one.example.strip().splitlines()[-1]}"
    if one.silent:
        yield "  symptom    none: nothing is raised, and the result is wrong"
    yield f"  cause      {one.cause}"
    yield f"  fix        {one.fix}"
    if one.packages:
        yield f"  concerns   {', '.join(one.packages)}"
    yield from (f"  reference  {reference}" for reference in one.references)
    yield (
        f"  measured   in {number(len(one.cells), 'cell')}"
        if one.cells
        else "  measured   in no cell that came with this version"
    )
    yield from (f"  simmatrix show {cell}" for cell in one.cells[:SHOWN])

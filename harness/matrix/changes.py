"""Apply a change to a cell, whether a matrix tries it by a name or a remedy asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from harness.matrix import overlay_recipes
from harness.model import Cell, Change, Question, Repair, replace
from harness.model.cellid import CellId
from harness.model.vocabulary import parsed_requirement, required_name
from harness.standalone.failures.remedies import describe_steps

NEVER = "python_version < '0'"
"""The marker of an override that takes a package out, whoever asks for it."""


# --- making it -------------------------------------------------------------------------------------------------


def apply(cell: Cell, change: Change, recipes: Mapping[str, tuple[Repair, ...]]) -> Cell:
    """Return the cell with a change made to it; `recipes` are the repairs of packages by name.

    Raises ValueError where no recipe repairs a package of its overlay.
    """
    return replace(
        cell,
        python=change.python or cell.python,
        question=_question(cell.question, change, recipes),
        environment={**cell.environment, **change.environment},
        empty=tuple(name for name in cell.empty if name not in change.environment),
    )


def _question(question: Question, change: Change, recipes: Mapping[str, tuple[Repair, ...]]) -> Question:
    packages = _names(change.requirements)
    gone = {*packages, *change.uninstall}
    requirements = _with_extras(change.requirements, question.requirements)
    changed = replace(
        question,
        requirements=_replaced(question.requirements, requirements, gone),
        constraints=_replaced(question.constraints, change.constraints, gone | _names(change.constraints)),
        overrides=_replaced(
            question.overrides,
            (*change.overrides, *(f"{name} ; {NEVER}" for name in change.uninstall)),
            gone | _names(change.overrides),
        ),
        build_constraints=_replaced(
            question.build_constraints, change.build_constraints, _names(change.build_constraints)
        ),
        build_variables={**question.build_variables, **change.build_variables},
        only_binary=tuple(dict.fromkeys((*question.only_binary, *change.only_binary))),
        absent=(*(name for name in question.absent if name not in gone), *change.uninstall),
        snapshot=change.as_of or question.snapshot,
    )
    names = tuple(dict.fromkeys((*(one.name for one in question.overlay), *change.overlay)))
    if not names:
        return changed
    return replace(changed, overlay=overlay_recipes.select(overlay_recipes.find_repairs(recipes, names), changed))


def _names(requirements: Iterable[str]) -> set[str]:
    return set(map(required_name, requirements))


def _replaced(lines: Iterable[str], new: Iterable[str], names: set[str]) -> tuple[str, ...]:
    """Return the lines except those on packages of these names, followed by the new ones."""
    return tuple(dict.fromkeys((*(line for line in lines if required_name(line) not in names), *new)))


def _with_extras(new: Iterable[str], old: Iterable[str]) -> Iterator[str]:
    """Yield new requirements, each with the extras of those it replaces, unless it has some of its own.

    So `gym<1` changes versions only. A requirement that takes over nothing stays as it is written.
    """
    extras: dict[str, set[str]] = {}
    for line in old:
        extras.setdefault(required_name(line), set()).update(parsed_requirement(line).extras)
    for line in new:
        taken = extras.get(required_name(line), set())
        if parsed_requirement(line).extras or not taken:
            yield line
        else:
            name = parsed_requirement(line).name
            yield line.replace(name, f"{name}[{','.join(sorted(taken))}]", 1)


def id_of(cell: Cell, name: str, change: Change) -> str:
    """Return the id of a cell with a change of this name; it says where the cell runs on another Python."""
    return str(CellId.parse(cell.id).changed(name, change.python if change.python != cell.python else None))


def same(cell: Cell, other: Cell) -> bool:
    """Return whether two cells come to the same measurement, whatever their ids and the order of their requirements."""
    return _plain(cell) == _plain(other)


def produces(base: Cell, change: Change, other: Cell) -> bool:
    """Return whether a change makes this other cell of a cell, and not the same cell again."""
    # This room does no I/O, so the recipes are put together from what both cells carry.
    recipes: dict[str, tuple[Repair, ...]] = {}
    for repair in (*base.question.overlay, *other.question.overlay):
        recipes[repair.name] = (*(one for one in recipes.get(repair.name, ()) if one != repair), repair)
    try:
        changed_cell = apply(base, change, recipes)
    except ValueError:  # it repairs what the other cell does not
        return False
    return same(changed_cell, other) and not same(changed_cell, base)


def _plain(cell: Cell) -> Cell:
    question = cell.question
    lists = ("requirements", "constraints", "overrides", "build_constraints", "only_binary", "absent")
    ordered: dict[str, Any] = {name: tuple(sorted(getattr(question, name))) for name in lists}
    question = replace(question, **ordered)
    overlay = tuple(sorted(question.overlay, key=lambda repair: (repair.name, repair.wheel)))
    return replace(cell, id="", question=replace(question, overlay=overlay), expect=None, base=None, tried=None)


def describe(change: Change) -> tuple[str, ...]:
    """Describe each thing that a change does in a few words."""
    return tuple(describe_steps(change.plain))

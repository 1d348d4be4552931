"""Derive changes that may turn a red cell green from its failure, in parts to combine and to leave out one by one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce
from typing import Any

from msgspec.structs import asdict, replace
from packaging.requirements import Requirement as ParsedRequirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.model import Cell, Change
from harness.model.vocabulary import parsed_requirement, required_name
from harness.standalone.failures.matching import Diagnosis


class Way(StrEnum):
    """The source of a change, the least intrusive first."""

    NAMED = "a bound that the error names"
    SIGNATURE = "the fix of a known issue"
    MISSING = "what is imported and not required"
    OVERLAY = "a repaired release"
    BUILDS = "build requirements of the time"
    REFUSED = "a bound that the error names, instead of what is asked for"
    DATE = "the index as it stood"
    LOCK = "a combination that works"
    WHEELS = "wheels only"
    VARIABLE = "a variable"
    DISPLAY = "a display"
    PYTHON = "another Python"
    PINS = "another version of what is asked for"


COSTS = {way: float(place) for place, way in enumerate(Way)} | {Way.PYTHON: 20.0, Way.PINS: 40.0}
"""What is tried first is least; of two that cure, the less costly is the smaller change."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Move:
    """A change to try. `why` says in words where it comes from."""

    change: Change
    way: Way
    why: str
    guard: bool = False
    """Whether it keeps big packages from being built here, which is none of what cures."""

    @property
    def cost(self) -> float:
        """Return the cost of the change: the more intrusive, the higher."""
        return COSTS[self.way]


# --- changes and their parts -----------------------------------------------------------------------------------

REPLACING = ("requirements", "constraints", "overrides", "build_constraints")
"""Lists of requirements: a later one on a package replaces an earlier."""


def merge_changes(first: Change, other: Change) -> Change:
    """Return both changes as one. If they disagree, the other one wins."""
    values = asdict(first)
    for name, new in asdict(other).items():
        old = values[name]
        if name in REPLACING:
            names = set(map(required_name, new))
            values[name] = (*(line for line in old if required_name(line) not in names), *new)
        elif isinstance(old, tuple):
            values[name] = tuple(dict.fromkeys((*old, *new)))
        else:
            values[name] = {**old, **new} if isinstance(old, dict) else new or old
    return Change(**values)


def parts(change: Change) -> tuple[Change, ...]:
    """Return the smallest changes that a change consists of."""
    pieces: list[Change] = []
    for name, value in asdict(change).items():
        single: Iterable[Any] = [value] if value else ()
        if isinstance(value, tuple):
            single = [(line,) for line in value]
        elif isinstance(value, dict):
            single = [{key: text} for key, text in value.items()]
        pieces += [Change(**{name: one}) for one in single]
    return tuple(pieces)


def of_parts(pieces: Iterable[Change]) -> Change:
    """Return the change that consists of these parts."""
    return reduce(merge_changes, pieces, Change())


def without(change: Change, part: Change) -> Change:
    """Return the change without some of its parts."""
    gone = parts(part)
    return of_parts(one for one in parts(change) if one not in gone)


# --- what the user asked for -----------------------------------------------------------------------------------


def pins(cell: Cell) -> dict[str, str]:
    """Return the packages that the cell pins, with their versions."""
    versions = {}
    for line in (*cell.question.requirements, *cell.question.constraints):
        version = _exact(parsed_requirement(line).specifier)
        if version:
            versions[required_name(line)] = version
    return versions


def _exact(specifier: SpecifierSet) -> str | None:
    clauses = list(specifier)
    exact = len(clauses) == 1 and clauses[0].operator in {"==", "==="} and not clauses[0].version.endswith(".*")
    return str(clauses[0].version) if exact else None


def asked_for(cell: Cell) -> tuple[str, ...]:
    """Return the packages that the cell requires itself."""
    return tuple(dict.fromkeys(map(required_name, cell.question.requirements)))


def find_replaced_packages(before: Cell, after: Cell) -> tuple[str, ...]:
    """Return the packages whose requirements or bounds, written by the user, were replaced by others."""

    def collect_bounds(cell: Cell) -> dict[str, set[str]]:
        by_package: dict[str, set[str]] = {}
        for line in (*cell.question.requirements, *cell.question.constraints):
            texts = {str(each) for each in parsed_requirement(line).specifier}
            by_package.setdefault(required_name(line), set()).update(texts)
        return by_package

    new_bounds = collect_bounds(after)

    def gone(name: str, texts: set[str]) -> bool:
        # A bound that the new ones imply is not replaced: `<1.24` still keeps `<2`.
        now = SpecifierSet(",".join(new_bounds.get(name, ())))
        return any(
            text not in new_bounds.get(name, ()) and str(tidy(now & SpecifierSet(text))) != str(now) for text in texts
        )

    return tuple(name for name, texts in collect_bounds(before).items() if gone(name, texts))


def constraint(cell: Cell, name: str, bound: str) -> str:
    """Return a bound on a package, combined with the bounds that the cell has on it already."""
    lines = [line for line in cell.question.constraints if required_name(line) == name]
    own = [parsed_requirement(line) for line in lines]
    specifiers = SpecifierSet(bound)
    for requirement in own:
        if requirement.marker is None:
            specifiers &= requirement.specifier
    return f"{name}{specifiers}"


def change_release(cell: Cell, name: str, bound: str) -> Change:
    """Return the change to other versions of a package: a requirement if the cell requires it, else a constraint."""
    if name in asked_for(cell):
        return Change(requirements=(f"{name}{bound}",))
    return Change(constraints=(f"{name}{bound}",))


# --- known failures --------------------------------------------------------------------------------------------


def propose_remedies(cell: Cell, diagnoses: Iterable[Diagnosis]) -> Iterator[Move]:
    """Yield the remedies of the known failures that fit, in their order: the deepest cause first, masks last.

    The user's own bounds are kept. A remedy that contradicts them counts as another version of what is asked for.
    """
    for diagnosis in diagnoses:
        change = diagnosis.signature.remedy.change
        if change:
            combined_change, contrary = merge_with_bounds(cell, change)
            yield Move(
                change=combined_change,
                way=Way.PINS if contrary else Way.SIGNATURE,
                why=f"the remedy of {diagnosis.signature.id}",
            )


def merge_with_bounds(cell: Cell, change: Change) -> tuple[Change, bool]:
    """Return the change with the cell's bounds on the same packages, and whether it contradicts one of them."""
    pieces, contrary = [replace(change, requirements=(), constraints=())], False
    requirements = {required_name(line): line for line in cell.question.requirements}
    bounds = {required_name(line): line for line in cell.question.constraints}
    for line in (*change.requirements, *change.constraints):
        name, plain = required_name(line), line in change.constraints
        old = [parsed_requirement(lines[name]) for lines in (requirements, bounds) if name in lines]
        both, clash = _both(line, old)
        contrary = contrary or clash
        if both is None:
            continue
        # A constraint that contradicts the user's pin leaves nothing to resolve, so the requirement itself changes.
        as_bound = plain and (name not in requirements or not clash)
        pieces.append(Change(constraints=(both,)) if as_bound else Change(requirements=(both,)))
    return of_parts(pieces), contrary or bool(set(change.uninstall) & set(requirements))


def _both(line: str, old: Sequence[ParsedRequirement]) -> tuple[str | None, bool]:
    """Return a requirement merged with the existing ones, and whether it contradicts them; None if they suffice."""
    new = parsed_requirement(line)
    if new.marker or not old or new.url:
        return line, False
    specifier, extras = SpecifierSet(), {extra for one in old for extra in one.extras}
    for requirement in old:
        specifier &= requirement.specifier
    both = specifier & new.specifier
    clash = both.is_unsatisfiable()
    exact = _exact(specifier)
    if exact and not clash and new.extras <= extras:
        return None, False
    listed = ",".join(sorted(new.extras | extras))
    name = f"{new.name}[{listed}]" if listed else new.name
    return f"{name}{new.specifier if clash else specifier if exact else tidy(both)}", clash


def tidy(specifiers: SpecifierSet) -> SpecifierSet:
    """Return the specifiers without redundant upper bounds: `<1.24`, not `<1.24,<2`."""
    uppers = [each for each in specifiers if each.operator == "<"]
    lowest = min(uppers, key=lambda each: Version(each.version), default=None)
    return SpecifierSet(",".join(str(each) for each in specifiers if each.operator != "<" or each == lowest))


# --- bounds -----------------------------------------------------------------------------------------------------------


def bound(good: str, bad: str) -> str:
    """Return the specifier that keeps a package on the good side of two neighbours: `<2`, never `<2.0.0`."""
    return f"<{short(bad)}" if Version(good) < Version(bad) else f">={short(good)}"


def short(version: str) -> str:
    """Return a version without the zeros at its end."""
    parsed_version = Version(version)
    # `release` has only the numbers: without the other parts the bound would name another version.
    if parsed_version.is_prerelease or parsed_version.is_postrelease or parsed_version.local or parsed_version.epoch:
        return version
    numbers = list(parsed_version.release)
    while len(numbers) > 1 and numbers[-1] == 0:
        numbers.pop()
    return ".".join(map(str, numbers))

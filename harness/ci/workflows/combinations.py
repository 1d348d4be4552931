"""Compute the combinations of a `strategy.matrix`, by GitHub's rules.

Those of the axes come first, without the excluded ones. An entry of `include` is then added to every one of them whose
own values it leaves as they are; what an earlier entry has added it may replace. Only an entry that fits none is a
combination more, and later entries are never added to such a one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from harness.ci.workflows.expressions import text_of

NOT_AXES = ("include", "exclude")


class Unreadable(ValueError):
    """Error for a matrix that GitHub itself knows only when the workflow runs. The message names the part."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Replaced:
    """A value that one entry of `include` had added and a later one (`index`) took away."""

    index: int
    name: str
    before: str
    after: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Combination:
    """One leg: name to value. `replaced` are the values that it lost to later entries of `include`."""

    values: Mapping[str, Any]
    replaced: tuple[Replaced, ...] = ()

    def __str__(self) -> str:
        return ", ".join(f"{name} {text_of(value)}" for name, value in self.values.items())


@dataclass(slots=True)
class _Leg:
    own: Mapping[str, Any]
    added: dict[str, Any] = field(default_factory=dict)
    replaced: list[Replaced] = field(default_factory=list)

    def add(self, index: int, entry: Mapping[str, Any]) -> None:
        """Add the values of an `include` entry, except those of the leg's axes. Note replaced values."""
        for name, value in entry.items():
            if name not in self.own:
                before = self.added.get(name, value)
                if not equal(before, value):
                    lost = Replaced(index=index, name=name, before=text_of(before), after=text_of(value))
                    self.replaced.append(lost)
                self.added[name] = value


def combinations(matrix: object) -> tuple[Combination, ...]:
    """Return every combination, in GitHub's order. Raises Unreadable if an expression stands for a part of it."""
    if not isinstance(matrix, dict):
        message = f"matrix: {_quoted(matrix)} is known only when the workflow runs"
        raise Unreadable(message)
    axes = {name: _listed(name, values) for name, values in matrix.items() if name not in NOT_AXES}
    included, excluded = (_entries(name, matrix.get(name) or []) for name in NOT_AXES)
    # Without axes `product` yields one empty combination, where GitHub has only the entries of `include`.
    originals = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())] if axes else []
    legs = [_Leg(own) for own in originals if not any(_fits(entry, own) for entry in excluded)]
    more: list[Mapping[str, Any]] = []
    for index, entry in enumerate(included):
        own = {name: value for name, value in entry.items() if name in axes}
        fitting = [leg for leg in legs if _fits(own, leg.own)]
        for leg in fitting:
            leg.add(index, entry)
        more += [] if fitting else [entry]
    merged = (Combination(values={**leg.own, **leg.added}, replaced=tuple(leg.replaced)) for leg in legs)
    return (*merged, *(Combination(values=entry) for entry in more))


def unmatched_excludes(matrix: Mapping[str, Any]) -> Iterator[int]:
    """Yield the indexes of the entries of `exclude` that leave nothing out."""
    axes = {name: values for name, values in matrix.items() if name not in NOT_AXES}
    originals = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    for index, entry in enumerate(matrix.get("exclude") or []):
        if not any(_fits(entry, own) for own in originals):
            yield index


def equal(first: Any, other: Any) -> bool:
    """Return whether two values of YAML are the same; `true` is not 1, and "3.1" is not 3.1."""
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (first, other))
    return bool(first == other) and (numbers or type(first) is type(other))


def _fits(entry: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
    return all(name in own and equal(own[name], value) for name, value in entry.items())


def _listed(name: str, values: object) -> Sequence[Any]:
    if not isinstance(values, list):
        message = f"matrix.{name}: {_quoted(values)} is known only when the workflow runs"
        raise Unreadable(message)
    return values


def _entries(name: str, entries: object) -> Sequence[Mapping[str, Any]]:
    listed = _listed(name, entries)
    for index, entry in enumerate(listed):
        if not isinstance(entry, dict):
            message = f"matrix.{name}[{index}]: {_quoted(entry)} is known only when the workflow runs"
            raise Unreadable(message)
    return listed


def _quoted(value: object) -> str:
    text = text_of(value)
    return f'"{text}"' if len(text) <= 60 else f'"{text[:57]}..."'

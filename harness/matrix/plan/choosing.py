"""Choose the combinations of a covering array from those that resolve: choose, ask, and choose again."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from packaging.version import Version

from harness.matrix.matrix_types import CONDITIONAL, NO_CHANGES, Changes, Chosen, Matrix, Unresolvable
from harness.matrix.plan.choices import Choice, Combination
from harness.matrix.plan.covering import Row, covering
from harness.matrix.plan.strategies import Candidates, weight
from harness.model import Cell, replace
from harness.model.cellid import CellId
from harness.model.schema import locate_errors
from harness.model.vocabulary import ABSENT, Kind

Ask = Callable[[Sequence[Cell]], list[str | None]]
"""Resolves what each cell asks; the answers are the lines that say why not, None where there is a lock."""


def choose(candidates: Candidates, ask: Ask, say: Callable[[str], None]) -> Chosen:
    """Find combinations that resolve and cover; those found not to resolve are kept with the reason.

    A combination that does not resolve is reduced to the pins that have a part in that, so that one answer rules out
    many combinations.
    """
    with locate_errors(candidates.matrix.path, "strategy"):
        candidates.check()
    search = _Search(candidates, ask)
    rows = search.run(say)
    return Chosen(
        made_from=candidates.made_from,
        axes=tuple(candidates.axes),
        combinations=tuple(tuple(choice.literal for choice in candidates.combination(row)) for row in rows),
        unresolvable=tuple(
            Unresolvable(axes={choice.axis: choice.literal for choice in part}, reason=search.found[part])
            for part in sorted(search.found, key=lambda part: [candidates.places[choice] for choice in part])
        ),
    )


class _Search:
    """A search for rows: those that resolved, and the values found not to resolve together."""

    def __init__(self, candidates: Candidates, ask: Ask) -> None:
        self.candidates = candidates
        self.ask = ask
        self.resolved: set[Row] = set()
        self.found: dict[tuple[Choice, ...], str] = {}
        # A constraint may hold for one value of such an axis only: then a failure speaks of that value alone.
        ruling = _ruling(candidates.matrix)
        apart = {name: choices for name, choices in candidates.axes.items() if name not in ruling}
        # An axis counts with all its values only: one that adds nothing may stand beside one that mends the failure.
        self.weightless = {name for name, choices in apart.items() if all(map(_is_weightless, choices))}
        self.free = [name for name, choices in apart.items() if all(map(_is_pin, choices))]
        if any(choice.text == ABSENT for choices in candidates.axes.values() for choice in choices):
            self.free = []  # without a pin, what is installed may bring what is to be absent

    def run(self, say: Callable[[str], None]) -> list[Row]:
        """Choose, ask, and choose again until all that is chosen resolves; return rows in order, without named ones."""
        ways = self.candidates.matrix.strategy.covering
        allowed = [self.candidates.row(each) for each in self.candidates.combinations.values()]
        named = [self.candidates.row(each) for each in self.candidates.named.values()]
        self._resolve_rows(named)
        while True:
            allowed = [row for row in allowed if not self._unresolvable(row)]
            given = [row for row in named if not self._unresolvable(row)]
            # Rows that resolved are preferred: each other one costs a question to the resolver.
            rows = covering(allowed, ways, given=given, preferred=sorted(self.resolved - set(named)))
            if not (new := [row for row in rows if row not in self.resolved]):
                return sorted(set(rows) - set(named))
            say(f"asking whether {len(new)} combinations resolve ({len(self.resolved)} of those chosen do)")
            self._resolve_rows(new)

    def _unresolvable(self, row: Row) -> bool:
        chosen = set(self.candidates.combination(row))
        return any(chosen.issuperset(part) for part in self.found)

    def _resolve_rows(self, rows: Sequence[Row]) -> None:
        whole = [self.candidates.combination(row) for row in rows]
        parts = {row: self._without(each, self.weightless) for row, each in zip(rows, whole, strict=True)}
        failed: dict[Row, str] = {}
        for row, reason in zip(rows, self._answers([(each, each) for each in whole]), strict=True):
            if reason is None:
                self.resolved.add(row)
            else:
                failed[row] = reason
        for axis in self.free:
            self._set_aside(axis, failed, parts)
        self.found.update({parts[row]: reason for row, reason in failed.items()})

    def _without(self, part: Combination, axes: Collection[str]) -> Combination:
        return tuple(choice for choice in part if choice.axis not in axes)

    def _set_aside(self, axis: str, failed: dict[Row, str], parts: dict[Row, Combination]) -> None:
        """Drop the pin of this axis from each failed part that fails without it as well."""
        smaller = {row: self._without(parts[row], {axis}) for row in failed}
        distinct = {part: row for row, part in smaller.items()}
        questions = [(self.candidates.combination(row), part) for part, row in distinct.items()]
        answers = dict(zip(distinct, self._answers(questions), strict=True))
        for row, part in smaller.items():
            if reason := answers[part]:
                parts[row], failed[row] = part, reason

    def _answers(self, questions: Sequence[tuple[Combination, Combination]]) -> list[str | None]:
        """Ask whether combinations resolve, each with only the pins of its given part."""
        return self.ask([self._cell(whole, part) for whole, part in questions])

    def _cell(self, whole: Combination, part: Combination) -> Cell:
        """Return a cell that is only resolved, never run."""
        name, contents = self.candidates.matrix.name, self.candidates.contents
        question = contents.question(whole)
        gone = {f"{choice.axis}=={choice.text}" for choice in set(whole) - set(part) if _is_pin(choice)}
        requirements = tuple(text for text in question.requirements if text not in gone)
        return Cell(
            id=str(CellId.build(name, [choice.label for choice in part])),
            matrix=name,
            axes={choice.axis: choice.text for choice in part},
            python=next(choice.literal for choice in whole if choice.kind is Kind.PYTHON),
            question=replace(question, requirements=requirements),
            environment={},
            cases=(),
            subject=contents.subject(whole),
        )


def _ruling(matrix: Matrix) -> set[str]:
    """Return the axes whose values decide whether a constraint applies."""
    tables: list[Changes] = [matrix, *(value.changes for axis in matrix.axes.values() for value in axis.values)]
    return {name for table in tables for key in CONDITIONAL for rule in getattr(table, key) for name in rule.when}


def _is_pin(choice: Choice) -> bool:
    """Return whether a value is only a pin, so that what fails without it fails with any. Pre-releases are not."""
    # A pre-release is let in by its own pin, so without that something else is asked.
    is_version = choice.kind is Kind.PACKAGE and choice.text != ABSENT and choice.changes is NO_CHANGES
    return is_version and not Version(choice.text).is_prerelease


def _is_weightless(choice: Choice) -> bool:
    """Return whether a value adds nothing to what is resolved, as environment variables do."""
    return choice.kind is Kind.VARIABLE or (choice.kind is Kind.BUNDLE and not weight(choice.changes))

"""Widen the bounds of a remedy as far as they cure: a known remedy may exclude releases that work here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from msgspec.structs import replace
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from harness.machine import interpreters
from harness.model import Change
from harness.model.vocabulary import parsed_requirement, required_name
from harness.rootcause import search
from harness.rootcause.bench import Trial
from harness.rootcause.repair import candidate_changes, times
from harness.rootcause.repair.lab import Lab, find_lost_check
from harness.rootcause.repair.narrowing import bound_of, line_between
from harness.rootcause.search import Answer

KINDS = ("requirements", "constraints")
UPPER, LOWER = frozenset({"<", "<="}), frozenset({">", ">="})


@dataclass(frozen=True, kw_only=True, slots=True)
class Bound:
    """One line of a remedy that bounds a package: `good` meets it and works, `bad` does not and failed."""

    kind: str
    line: str
    good: Version
    bad: Version

    @property
    def name(self) -> str:
        """Return the name of the package."""
        return required_name(self.line)

    @property
    def side(self) -> frozenset[str]:
        """Return the operators that keep the bad release out."""
        return UPPER if self.good < self.bad else LOWER

    def put(self, change: Change, specifier: str) -> Change:
        """Return the change with other versions in this line."""
        parsed = parsed_requirement(self.line)
        old = str(parsed.specifier)
        name = f"{parsed.name}[{','.join(sorted(parsed.extras))}]" if parsed.extras else parsed.name
        lines = tuple(f"{name}{specifier}" if line == self.line else line for line in getattr(change, self.kind))
        if specifier == old:
            return change
        return replace(change, requirements=lines) if self.kind == KINDS[0] else replace(change, constraints=lines)


@dataclass
class Widening:
    """One search in a lab: `change` cures what failed `before`, `after` is the cell with it."""

    lab: Lab
    change: Change
    before: Trial
    after: Trial
    bound: int = 0
    notes: list[str] = field(default_factory=list)

    def run(self) -> Change:
        """Return the change with each of its bounds as wide as possible."""
        change = self.change
        for bound in self._bounds():
            change = self._widest(bound, change)
        return change

    def _bounds(self) -> Iterator[Bound]:
        """Yield the lines that only bound a package whose version changed and that the user does not pin."""
        old, new = self.before.versions, self.after.versions
        pinned = candidate_changes.pins(self.lab.base)
        for kind in KINDS:
            for line in getattr(self.change, kind):
                name, parsed = required_name(line), parsed_requirement(line)
                inside = [each.operator in UPPER | LOWER for each in parsed.specifier]
                version_changed = name in old and name in new and old[name] != new[name]
                if version_changed and name not in pinned and inside and all(inside) and not parsed.marker:
                    yield Bound(kind=kind, line=line, good=Version(new[name]), bad=Version(old[name]))

    def _widest(self, bound: Bound, change: Change) -> Change:
        line = self._line(bound)
        specifier = parsed_requirement(bound.line).specifier
        outside = [place for place, version in enumerate(line) if version not in specifier]
        if len(line) <= 2 or not outside:
            return change

        def test(version: Version) -> Answer:
            trial = self.lab.measure(bound.put(change, f"=={version}"), f"with {bound.name} {version}")
            if trial.works and find_lost_check(self.before, trial) is None:
                return Answer.GOOD
            return Answer.BAD if trial.bad else Answer.UNTESTABLE

        answers = {0: [Answer.GOOD], outside[0]: [test(line[outside[0]])]}
        if answers[outside[0]] == [Answer.BAD] and line[outside[0] - 1] in specifier:
            return change  # it excludes no release that works
        self.bound += search.bound(len(line))
        boundary = search.boundary(line, test, prior_answers=answers)
        if boundary.good is None or boundary.bad is None:
            return change
        self.notes.append(f"{bound.name} {boundary.good} works, {boundary.bad} does not")
        rest = [str(each) for each in specifier if each.operator not in bound.side]
        return bound.put(change, str(SpecifierSet(",".join([*rest, bound_of(boundary)]))))

    def _line(self, bound: Bound) -> list[Version]:
        """Return the releases from the good one to the bad one, both included."""
        python, offline = interpreters.find(self.after.cell.python), self.lab.settings.offline
        releases = times.usable(self.lab.base, bound.name, python, wheels=True, offline=offline)
        return line_between(bound.good, bound.bad, releases)

"""Narrow a working lock to the fewest packages that have to be bounded, and each bound to where it begins."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from packaging.version import Version

from harness.model import Cell, Change, Interpreter, Phase
from harness.rootcause import search
from harness.rootcause.bench import Trial
from harness.rootcause.repair import candidate_changes, failure_hints, times
from harness.rootcause.repair.candidate_changes import merge_changes
from harness.rootcause.repair.lab import Lab, find_lost_check, passes
from harness.rootcause.search import Answer

SINGLES = 2
"""Packages that are tried alone before any search: those that the failure names, then those that its logs name most."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Suspect:
    """A package in which two locks differ. `build` is true if builds use it, `required` if the user requires it."""

    name: str
    good: str
    bad: str | None
    build: bool = False
    required: bool = False

    def at(self, bound: str) -> Change:
        """Return the change that holds the package to a bound."""
        line = f"{self.name}{bound}"
        if self.required:
            return Change(requirements=(line,))
        return Change(build_constraints=(line,)) if self.build else Change(constraints=(line,))


@dataclass
class Narrowing:
    """One search in a lab. `rest` is the part of the remedy that stays as it is, `failing` the trial to cure.

    `bound` is how many tests a binary search for single culprits needs at most.
    """

    lab: Lab
    rest: Change
    failing: Trial
    interpreter: Interpreter | None
    bound: int = 0
    notes: list[str] = field(default_factory=list)

    # --- which packages --------------------------------------------------------------------------------------------

    def fewest(self, suspects: Sequence[Suspect]) -> tuple[Suspect, ...] | None:
        """Return the fewest suspects that cure when held to their good versions; None if all together do not."""
        evidence = self.failing.assessed.failures
        order = failure_hints.suspects([one.name for one in suspects], evidence)
        ranked = sorted(suspects, key=lambda suspect: (not suspect.build, order.index(suspect.name)))
        self.bound += search.bound(len(ranked) + 1)
        builds = [one for one in ranked if one.build]
        for sole in (builds[:1] or ranked)[:SINGLES]:
            if self._held([sole]) is Answer.GOOD:
                return (sole,)
        if self._held(ranked) is not Answer.GOOD:
            return None
        culprits = search.minimise(ranked, self._held).items
        if culprits is None:
            return None
        self.notes.append(f"of {len(ranked)} packages that differ, {len(culprits)} decide")
        return tuple(culprits)

    def _held(self, chosen: Sequence[Suspect]) -> Answer:
        names = ", ".join(f"{one.name} {one.good}" for one in chosen[:4])
        more = f" and {len(chosen) - 4} more" if len(chosen) > 4 else ""
        return self._answer(hold_packages(chosen), f"with {names or 'nothing'}{more} as in the lock that works")

    def _answer(self, change: Change, why: str) -> Answer:
        trial = self.lab.measure(merge_changes(self.rest, change), why)
        if self._cured(trial):
            return Answer.GOOD
        failed = trial.failure
        # A mix of two locks may not resolve, which says nothing about a failure in a later phase.
        early, before = {Phase.RESOLVE, Phase.INSTALL}, self.failing.failure
        if failed is None or (failed.phase in early and not (before and before.phase in early)):
            return Answer.UNTESTABLE
        return Answer.BAD

    def _cured(self, trial: Trial) -> bool:
        """Return whether a trial passed the phase that matters; if it is the last one, with no check left out."""
        if self.lab.until is Phase.SUITE:
            return trial.works and find_lost_check(self.failing, trial) is None
        return passes(trial, self.lab.until)

    # --- from where on ---------------------------------------------------------------------------------------------

    def bounded(self, chosen: Sequence[Suspect]) -> Change:
        """Return the change that holds each package to the good side of its boundary.

        Meanwhile the other packages are held to theirs.
        """
        held: dict[str, Change] = {one.name: one.at(f"=={one.good}") for one in chosen}
        for suspect in chosen:
            others = candidate_changes.of_parts(change for name, change in held.items() if name != suspect.name)
            held[suspect.name] = self._boundary(suspect, others)
        return candidate_changes.of_parts(held.values())

    def _boundary(self, suspect: Suspect, others: Change) -> Change:
        line = self._line(suspect)
        if len(line) < 2 or (len(line) == 2 and suspect.required):
            return suspect.at(f"=={suspect.good}")
        self.bound += search.bound(len(line))

        def test(version: Version) -> Answer:
            return self._answer(merge_changes(others, suspect.at(f"=={version}")), f"with {suspect.name} {version}")

        def ahead(progress: search.Progress[Version]) -> None:
            wanted = [merge_changes(others, suspect.at(f"=={version}")) for version in progress.upcoming[:1]]
            self.lab.prepare(*(merge_changes(self.rest, each) for each in wanted))

        answers = {0: [Answer.GOOD]}
        if not others and not suspect.required:
            answers[len(line) - 1] = [Answer.BAD]  # that is what failed
        for place in _likely(line):
            answers[place] = [test(line[place])]
            if answers[place] != [Answer.BAD]:
                break
        boundary = search.boundary(line, test, prior_answers=answers, watch=ahead)
        if boundary.good is None or boundary.bad is None:
            return suspect.at(f"=={suspect.good}")
        if suspect.required:
            return suspect.at(f"=={boundary.good}")
        self.notes.append(f"{suspect.name} {boundary.good} works, {boundary.bad} does not")
        bound = bound_of(boundary)
        if not suspect.build:
            # The cell may have bounds on the package already.
            bound = candidate_changes.constraint(self.lab.base, suspect.name, bound).removeprefix(suspect.name)
        return suspect.at(bound)

    def _line(self, suspect: Suspect) -> list[Version]:
        """Return the releases from the good one to the bad one, both included."""
        offline = self.lab.settings.offline
        releases = times.usable(
            self.lab.base, suspect.name, self.interpreter, wheels=not suspect.build, offline=offline
        )
        # If no release has a wheel, the package is built in any case.
        releases = releases or times.usable(
            self.lab.base, suspect.name, self.interpreter, wheels=False, offline=offline
        )
        good = Version(suspect.good)
        return line_between(good, Version(suspect.bad) if suspect.bad else max(releases, default=good), releases)


def line_between(good: Version, bad: Version, releases: Iterable[Version]) -> list[Version]:
    """Return the releases from the good one to the bad one, both included."""
    low, high = sorted((good, bad))
    line = sorted({low, high, *(each for each in releases if low < each < high)})
    return line if good == low else line[::-1]


def bound_of(boundary: search.Boundary[Version]) -> str:
    """Return the specifier that allows what was seen to work: releases that could not be tested stay out of it."""
    beyond = boundary.between[0] if boundary.between else boundary.bad
    return candidate_changes.bound(str(boundary.good), str(beyond))


def _likely(line: Sequence[Version]) -> list[int]:
    """Return the place after the last change of the major number, and the one before: the likeliest boundaries."""
    turns = [place for place in range(1, len(line)) if line[place].major != line[place - 1].major]
    return [place for place in ([turns[-1], turns[-1] - 1] if turns else []) if 0 < place < len(line) - 1]


def hold_packages(chosen: Iterable[Suspect]) -> Change:
    """Return the change that holds packages to their good versions."""
    return candidate_changes.of_parts(one.at(f"=={one.good}") for one in chosen)


def differing(base: Cell, good: Trial, bad: Trial) -> tuple[Suspect, ...]:
    """Return the packages in which two locks differ; all of the good one if the bad one has none.

    Packages that the user pins are left out.
    """
    old, new = bad.versions, good.versions
    pinned = candidate_changes.pins(base)
    return tuple(
        Suspect(name=name, good=version, bad=old.get(name))
        for name, version in sorted(new.items())
        if old.get(name) != version and name not in pinned and (name in old or not old)
    )

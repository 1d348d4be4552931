"""Narrow a working lock to the fewest packages that have to be bounded, and each bound to where it begins."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from packaging.version import Version

from harness.model import Change, Interpreter, Phase
from harness.rootcause import search
from harness.rootcause.bench import Trial
from harness.rootcause.repair import candidate_changes, failure_hints, times
from harness.rootcause.repair.candidate_changes import together
from harness.rootcause.repair.lab import Lab, passes, versions, weaker
from harness.rootcause.search import Answer

SINGLES = 2
"""Packages that are tried alone before any search: those that the failure names, then those that its logs name most."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Suspect:
    """A package in which two locks differ. `build` is true if builds use it, `asked` if the user requires it."""

    name: str
    good: str
    bad: str | None
    build: bool = False
    asked: bool = False

    def at(self, bound: str) -> Change:
        """Return the change that holds the package to a bound."""
        line = f"{self.name}{bound}"
        if self.asked:
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
    told: list[str] = field(default_factory=list)

    # --- which packages --------------------------------------------------------------------------------------------

    def fewest(self, suspects: Sequence[Suspect]) -> tuple[Suspect, ...] | None:
        """Return the fewest suspects that cure when held to their good versions; None if all together do not."""
        evidence = self.lab.evidence(self.failing)
        order = failure_hints.suspects([one.name for one in suspects], evidence)
        ranked = sorted(suspects, key=lambda one: (not one.build, order.index(one.name)))
        self.bound += search.bound(len(ranked) + 1)
        builds = [one for one in ranked if one.build]
        for one in (builds[:1] or ranked)[:SINGLES]:
            if self._held([one]) is Answer.GOOD:
                return (one,)
        if self._held(ranked) is not Answer.GOOD:
            return None
        found = search.minimise(ranked, self._held).items
        if found is None:
            return None
        self.told.append(f"of {len(ranked)} packages that differ, {len(found)} decide")
        return tuple(found)

    def _held(self, chosen: Sequence[Suspect]) -> Answer:
        names = ", ".join(f"{one.name} {one.good}" for one in chosen[:4])
        more = f" and {len(chosen) - 4} more" if len(chosen) > 4 else ""
        return self._answer(held(chosen), f"with {names or 'nothing'}{more} as in the lock that works")

    def _answer(self, change: Change, why: str) -> Answer:
        trial = self.lab.measure(together(self.rest, change), why)
        if self._cured(trial):
            return Answer.GOOD
        failed = trial.failure
        if failed is None or (failed.phase in {Phase.RESOLVE, Phase.INSTALL} and not self._early):
            return Answer.UNTESTABLE
        return Answer.BAD

    def _cured(self, trial: Trial) -> bool:
        """Return whether a trial passed the phase that matters; if it is the last one, with no check left out."""
        if self.lab.until is Phase.SUITE:
            return trial.works and weaker(self.failing, trial) is None
        return passes(trial, self.lab.until)

    @property
    def _early(self) -> bool:
        """Return whether the failure to cure is one of resolving or installing."""
        failed = self.failing.failure
        return failed is not None and failed.phase in {Phase.RESOLVE, Phase.INSTALL}

    # --- from where on ---------------------------------------------------------------------------------------------

    def bounded(self, chosen: Sequence[Suspect]) -> Change:
        """Return the change that holds each package to the good side of its boundary.

        Meanwhile the other packages are held to theirs.
        """
        held: dict[str, Change] = {one.name: one.at(f"=={one.good}") for one in chosen}
        for one in chosen:
            others = candidate_changes.of_parts(change for name, change in held.items() if name != one.name)
            held[one.name] = self._boundary(one, others)
        return candidate_changes.of_parts(held.values())

    def _boundary(self, one: Suspect, others: Change) -> Change:
        line = self._line(one)
        if len(line) <= 2 and one.asked:
            return one.at(f"=={one.good}")
        if len(line) < 2:
            return one.at(f"=={one.good}")
        self.bound += search.bound(len(line))

        def test(version: Version) -> Answer:
            return self._answer(together(others, one.at(f"=={version}")), f"with {one.name} {version}")

        def ahead(progress: search.Progress[Version]) -> None:
            wanted = [together(others, one.at(f"=={version}")) for version in progress.upcoming[:1]]
            self.lab.prepare(*(together(self.rest, each) for each in wanted))

        known = {0: [Answer.GOOD]}
        if candidate_changes.empty(others) and not one.asked:
            known[len(line) - 1] = [Answer.BAD]  # that is what failed
        for place in _likely(line):
            known[place] = [test(line[place])]
            if known[place] != [Answer.BAD]:
                break
        found = search.boundary(line, test, known=known, watch=ahead)
        if found.good is None or found.bad is None:
            return one.at(f"=={one.good}")
        if one.asked:
            return one.at(f"=={found.good}")
        beyond = found.between[0] if found.between else found.bad
        self.told.append(f"{one.name} {found.good} works, {found.bad} does not")
        return one.at(self._said(one, candidate_changes.bound(str(found.good), str(beyond))))

    def _said(self, one: Suspect, bound: str) -> str:
        """Return the bound, combined with those that the cell has on the package already."""
        if one.build:
            return bound
        return candidate_changes.constraint(self.lab.base, one.name, bound).removeprefix(one.name)

    def _line(self, one: Suspect) -> list[Version]:
        """Return the releases from the good one to the bad one, both included."""
        offline = self.lab.settings.offline
        known = times.usable(self.lab.base, one.name, self.interpreter, wheels=not one.build, offline=offline)
        known = known or times.usable(self.lab.base, one.name, self.interpreter, wheels=False, offline=offline)
        good = Version(one.good)
        bad = Version(one.bad) if one.bad else max(known, default=good)
        low, high = min(good, bad), max(good, bad)
        found = sorted({good, bad, *(each for each in known if low < each < high)})
        return found if good <= bad else found[::-1]


def _likely(line: Sequence[Version]) -> list[int]:
    """Return the place after the last change of the major number, and the one before: the likeliest boundaries."""
    turns = [place for place in range(1, len(line)) if line[place].major != line[place - 1].major]
    return [place for place in ([turns[-1], turns[-1] - 1] if turns else []) if 0 < place < len(line) - 1]


def held(chosen: Iterable[Suspect]) -> Change:
    """Return the change that holds packages to their good versions."""
    return candidate_changes.of_parts(one.at(f"=={one.good}") for one in chosen)


def differing(lab: Lab, good: Trial, bad: Trial) -> tuple[Suspect, ...]:
    """Return the packages in which two locks differ; all of the good one if the bad one has none.

    Packages that the user pins are left out.
    """
    old, new = versions(lab, bad), versions(lab, good)
    pinned = candidate_changes.pins(lab.base)
    return tuple(
        Suspect(name=name, good=version, bad=old.get(name))
        for name, version in sorted(new.items())
        if old.get(name) != version and name not in pinned and (name in old or not old)
    )

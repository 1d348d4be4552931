"""Judge whether a candidate of a bisection fails with the same failure, or, if requested, with any."""

from __future__ import annotations

import re
from dataclasses import dataclass

from harness.judging.identity import Failure
from harness.model import FAILING, Outcome, Phase, Verdict, replace
from harness.model.vocabulary import CHANGING
from harness.rootcause.bench import Trial
from harness.rootcause.search import Answer

# The count differs from measurement to measurement, so with it a flaky failure would not equal itself.
FLAKY = re.compile(r"^passed \d+ of \d+ runs; else: ")
BETTER = frozenset({Outcome.PASSED, Outcome.SKIPPED})


@dataclass(frozen=True, kw_only=True, slots=True)
class Classification:
    """The answer of a trial, for the search and in words. `why` names a failure other than the one looked for."""

    answer: Answer
    why: str | None
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Predicate:
    """The failure that a bisection looks for; None for any."""

    failure: Failure | None

    @property
    def until(self) -> Phase:
        """Return the last phase that matters."""
        return (self.failure.phase if self.failure else None) or Phase.SUITE

    @property
    def words(self) -> str:
        """Return the definition of bad in words."""
        if self.failure is None:
            return "any failure"
        cause = f", {self.failure.causes[0]}" if self.failure.causes else ""
        return f"the same failure: {self.failure.phase or 'some phase'}{cause}: {self.failure.line}"

    def classify(self, trial: Trial) -> Classification:
        """Return the answer of a trial."""
        failed = strip_run_count(trial.failure)
        if failed is None:
            return self._classify_without_failure(trial)
        line = f"{failed.phase}: {failed.line}" if failed.phase else failed.line
        if self.failure is None or self.failure.same(failed):
            flaky = failed.phase is not None and trial.assessed.phases.get(failed.phase) is Outcome.FLAKY
            return Classification(answer=Answer.FLAKY if flaky else Answer.BAD, why=None, words=line)
        if self._passed(trial):
            return Classification(answer=Answer.GOOD, why=None, words=f"passes {self.until}; fails later: {line}")
        # Candidates between two that fail equally are assumed to fail so, too; but good releases may lie between two
        # that do not install for the same reason, so these get no key to fill in by.
        cause = failed.causes[0] if failed.causes else CHANGING.sub("…", failed.line)
        cause_key = None if failed.phase in {Phase.RESOLVE, Phase.INSTALL} else f"{failed.phase}: {cause}"
        return Classification(answer=Answer.UNTESTABLE, why=cause_key, words=line)

    def _classify_without_failure(self, trial: Trial) -> Classification:
        if trial.works:
            return classify_working(trial)
        if trial.doubtful:
            words = f"works, not verified: {', '.join(trial.assessed.unverified)}"
            return Classification(answer=Answer.UNTESTABLE, why=None, words=words)
        if self.failure is not None and self._passed(trial):
            return Classification(answer=Answer.GOOD, why=None, words=f"passes {self.until}")
        return Classification(answer=Answer.UNTESTABLE, why=None, words=trial.failure_text)

    def _passed(self, trial: Trial) -> bool:
        """Return whether a trial passed the phase that failed, and all phases before it."""
        if self.failure is None:
            return False
        order = list(Phase)
        before = order[: order.index(self.until) + 1]
        phases = [trial.assessed.phases.get(phase, Outcome.SKIPPED) for phase in before]
        # A misleading check that fails leaves its phase passed, so the outcomes of the phases are not enough.
        misleads = trial.assessed.verdict is Verdict.MISLEADS and trial.assessed.phase in before
        return phases[-1] is Outcome.PASSED and set(phases) <= BETTER and not misleads


def classify_working(trial: Trial) -> Classification:
    """Return the answer of a trial that does everything requested."""
    return Classification(answer=Answer.GOOD, why=None, words=trial.success_text)


def strip_run_count(failed: Failure | None) -> Failure | None:
    """Return a failure without the count of how often it showed."""
    return replace(failed, line=FLAKY.sub("", failed.line)) if failed else None


def line_key(failed: Failure) -> tuple[Phase | None, str]:
    """Return a key that differs if the decisive lines differ, whichever known failure both may be."""
    return failed.phase, CHANGING.sub("…", failed.line)


def has_package_failure(trial: Trial) -> bool:
    """Return whether a trial failed because of its packages."""
    if trial.assessed.verdict is Verdict.MISLEADS:
        return True
    return trial.failure is not None and any(outcome in FAILING for outcome in trial.assessed.phases.values())

"""Fold the runs of a package's own test suite into its phase, and say which run is needed next. All of it is pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from harness.judging.runs.check import TAKEN_AWAY, Ending
from harness.judging.runs.fold import MEASURED_AGAIN, RUNS_TO_CONFIRM, environment_findings
from harness.judging.runs.pytest_report import Report, outcome_of
from harness.model import FAILING, CheckRecord, Finding, Level, Outcome, Phase, PhaseRecord, Suite, replace
from harness.probes.evidence import JUNIT, LOG, MODULES, Reading, Request
from harness.standalone.failures.lines import normalise, shorten_line

CHECK = "suite.pytest"
SOURCE = "$SUBJECT"
"""The name of the copy of the source in evidence."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Ended:
    """The end of the suite in a run, and whether it passed in the runs that were to confirm that."""

    reading: Reading
    outcome: Outcome
    decisive: str | None
    report: Report
    findings: tuple[Finding, ...]
    attempts: int = 1
    passed_again: tuple[bool, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Folded:
    """The results of the runs of a suite so far. `overran` is true if one ran out of time already."""

    ended: Ended | None = None
    overran: bool = False
    runs: tuple[str, ...] = ()

    def reusable(self, conditions: str | None, *, failed_too: bool) -> Folded:
        """Return the part that need not be measured again on a system of these conditions."""
        if self.ended is None or self.ended.outcome in MEASURED_AGAIN:
            return Folded()
        measured_under = self.ended.reading.run.host.conditions
        stands = failed_too and measured_under in {None, conditions}
        return self if self.ended.outcome not in FAILING or stands else Folded()


def fold(readings: Iterable[Reading], before: Folded | None = None) -> Folded:
    """Add these runs, in their order, to the results so far."""
    folded = before or Folded()
    for reading in readings:
        folded = add_run(folded, reading)
    return folded


def judged_again(readings: Iterable[Reading]) -> PhaseRecord | None:
    """Return the phase of the suite by these runs alone; None if they did not bring it to an end."""
    folded = fold(readings)
    return phase(folded, reused=False) if folded.ended else None


def add_run(folded: Folded, reading: Reading) -> Folded:
    """Add one more run to the results so far."""
    ended, runs = _judge_run(reading), (*folded.runs, reading.name)
    if reading.run.request.confirms:
        if folded.ended is None:
            return folded
        passed_again = (*folded.ended.passed_again, ended.outcome is Outcome.PASSED)
        return replace(folded, ended=replace(folded.ended, passed_again=passed_again), runs=runs)
    if ended.outcome is Outcome.TIMED_OUT and not folded.overran:
        return Folded(overran=True, runs=runs)
    return Folded(ended=replace(ended, attempts=2 if folded.overran else 1), overran=folded.overran, runs=runs)


def todo(suite: Suite, folded: Folded, *, verify: bool) -> Request | None:
    """Return the run that is needed next; None where it is known how the suite ends."""
    ended = folded.ended
    if ended is None:
        return Request(suite=suite, limits={CHECK: suite.seconds * (2 if folded.overran else 1)})
    # A suite that ends by its time limit has met it twice already: `add_run` does not count the first time.
    again = len(ended.passed_again) < RUNS_TO_CONFIRM - 1 and ended.outcome is not Outcome.TIMED_OUT
    if verify and again and ended.outcome in FAILING:
        return Request(suite=suite, limits={CHECK: 2 * suite.seconds}, confirms=True)
    return None


def phase(folded: Folded, *, reused: bool) -> PhaseRecord:
    """Return the phase record of the suite. Raises ValueError if the suite did not end."""
    if folded.ended is None:
        message = "the suite did not end"
        raise ValueError(message)
    ended, run = folded.ended, folded.ended.reading.run
    outcome, decisive, passed = ended.outcome, ended.decisive, sum(ended.passed_again)
    if passed:
        outcome, decisive = Outcome.FLAKY, f"passed {passed} of {RUNS_TO_CONFIRM} runs; else: {decisive}"
    check = CheckRecord(
        check=CHECK,
        outcome=outcome,
        seconds=round(run.end.seconds, 3),
        decisive=decisive,
        facts={"tests": dict(ended.report.tests), "failed": list(ended.report.bad)},
    )
    return PhaseRecord(
        phase=Phase.SUITE,
        outcome=outcome,
        seconds=check.seconds,
        decisive=decisive,
        checks=(check,),
        findings=ended.findings,
        evidence=ended.reading.folder,
        attempts=RUNS_TO_CONFIRM if ended.passed_again else ended.attempts,
        measured=run.measured,
        runs=folded.runs,
        reused=reused,
    )


def _judge_run(reading: Reading) -> Ended:
    run, report = reading.run, Report.read(reading.text(JUNIT))
    outcome, decisive = _judge_outcome(reading, report)
    if outcome in FAILING and not run.host.stood:
        outcome, decisive = Outcome.INFRA, TAKEN_AWAY
    findings = environment_findings(run.end.written, run.end.stray, Phase.SUITE)
    if outcome is Outcome.SKIPPED:  # a suite that says nothing is not passed over in silence
        empty = Finding(check="suite.empty", level=Level.WARNING, text=decisive or "no test ran")
        findings = (*findings, empty)
    return Ended(
        reading=reading,
        outcome=outcome,
        decisive=shorten_line(normalise(decisive, {})) if decisive else None,
        report=report,
        findings=findings,
    )


def _judge_outcome(reading: Reading, report: Report) -> tuple[Outcome, str | None]:
    if reading.run.host.source is not None:
        return Outcome.INFRA, reading.run.host.source
    return _foreign(reading.text(MODULES)) or outcome_of(report, ending_of(reading), reading.text(LOG))


def _foreign(imports: str) -> tuple[Outcome, str] | None:
    """Return an infra outcome if a module of the subject was imported from the copy of its source; else None.

    In that case, something other than the installed package was tested.
    """
    for line in imports.splitlines():
        name, _, path = line.partition("\t")
        if path.startswith(f"{SOURCE}/"):
            where = path.removeprefix(f"{SOURCE}/")
            return Outcome.INFRA, f"the tests import {name} from {where} of the source, not as it is installed"
    return None


def ending_of(reading: Reading) -> Ending:
    """Return the end of a suite's process. If its display died and it did not pass, that is the trouble."""
    end, request = reading.run.end, reading.run.request
    short = f"needs more than the {request.memory_mb} MB that the suite may have; `suite.memory_mb` raises that"
    lost = end.lost if end.exit_code != 0 else None
    return Ending(
        exit_code=end.exit_code,
        signal=end.signal,
        overran=request.limits[CHECK] if end.timed_out else None,
        trouble=None if end.timed_out else lost or end.killed or (short if end.out_of_memory else None),
    )

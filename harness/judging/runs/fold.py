"""Fold the probe runs of a case into how its checks ended.

A check ends with the last run that showed it. A time limit that ran out, and a process that somebody outside ended, are
tried once more; so is a run that met an environment, or byte code, that was not whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from itertools import islice
from types import MappingProxyType

from msgspec import Struct

from harness.judging.runs import native_errors
from harness.judging.runs.check import TAKEN_AWAY, check_record, ending_of, phase_of, side_findings, was_killed
from harness.model import (
    CASE_PHASES,
    FAILING,
    Case,
    CheckRecord,
    CheckReply,
    Finding,
    Level,
    Outcome,
    Phase,
    replace,
)
from harness.model.machine_trouble import CUT_SHORT, SHOT
from harness.model.vocabulary import MISLEADING
from harness.probes import wire
from harness.probes.evidence import Reading, Request
from harness.standalone.failures.lines import normalise

DEFAULT_SECONDS = 120.0
RUNS_TO_CONFIRM = 3
MOST_FRAMES, MOST_WRITTEN = 4, 5
"""Frames that are shown of one check, and files that a finding names."""

LOOP, REPEAT, ACROSS = "single.loop", "single.repeat", "single.repeat.process"

MEASURED_AGAIN = frozenset({Outcome.INFRA, Outcome.UNAVAILABLE, Outcome.TIMED_OUT, Outcome.NOT_REACHED})
"""Outcomes that another run may change: never reused."""

Wanted = Mapping[Phase, tuple[str, ...]]
"""The checks of each phase."""


class CasePlan(Struct, frozen=True, kw_only=True):
    """The checks of a case to run, by phase, and the digest of the in-cell program for each check.

    With `verify` each check has a process of its own, and a failure is confirmed.
    """

    case: Case
    wanted: Wanted
    program: Mapping[str, str]
    verify: bool = False

    @property
    def checks(self) -> list[str]:
        """Return the checks in the order in which they are run."""
        return [check for names in self.wanted.values() for check in names]

    def seconds(self, check: str) -> float:
        """Return the time limit of a check, in seconds."""
        return self.case.timeouts.get(phase_of(check), DEFAULT_SECONDS)


class Ended(Struct, frozen=True, kw_only=True):
    """The end of a check, its run, and the files of that run. `passed_again` tells which confirming runs passed."""

    record: CheckRecord
    reading: str
    folder: str
    measured: str
    conditions: str | None
    attempts: int = 1
    frames: tuple[str, ...] = ()
    peak_mb: int | None = None
    passed_again: tuple[bool, ...] = ()

    def confirmed(self) -> CheckRecord:
        """Return the record of the check: flaky if a failure did not come again."""
        passed = sum(self.passed_again)
        if not passed:
            return self.record
        line = f"passed {passed} of {RUNS_TO_CONFIRM} runs; else: {self.record.decisive}"
        return replace(self.record, outcome=Outcome.FLAKY, decisive=line)


class Folded(Struct, frozen=True, kw_only=True):
    """All that the runs of a case showed so far.

    `ended` has each check that came to an end. `followed` names the run in which each check that follows another was
    looked at; `missed` are those that were not, as the other one did not pass this time. `findings` has the findings of
    each run, each with the check during which it was made, if any. `overran` and `shot` are checks that were tried once
    and are due again, or have been. `again` is the request to repeat: `taken_away` and `recompiled` tell that this
    happened once, for an environment or byte code in pieces. `runs` names all runs that count.
    """

    ended: Mapping[str, Ended] = {}
    followed: Mapping[str, str] = {}
    missed: frozenset[str] = frozenset()
    findings: Mapping[str, tuple[tuple[str | None, Finding], ...]] = {}
    overran: frozenset[str] = frozenset()
    shot: frozenset[str] = frozenset()
    again: Request | None = None
    taken_away: bool = False
    recompiled: bool = False
    runs: tuple[str, ...] = ()

    def reusable(self, conditions: str | None, *, failed_too: bool) -> Folded:
        """Return the part that need not be measured again on a system of these conditions."""

        def holds(ended: Ended) -> bool:
            outcome = ended.confirmed().outcome
            if outcome in FAILING:
                return failed_too and outcome not in MEASURED_AGAIN and ended.conditions in {None, conditions}
            return outcome not in MEASURED_AGAIN

        ended = {check: one for check, one in self.ended.items() if holds(one)}
        gone = (self.ended.keys() - ended.keys()) | self.missed
        followed = {check: run for check, run in self.followed.items() if not {check, wire.leader_of(check)} & gone}
        # `overran`, `shot` and `missed` are left behind: the next run of the program may try each once more.
        return Folded(ended=ended, followed=followed, findings=self.findings, runs=self.runs)


def fold(case_plan: CasePlan, readings: Iterable[Reading], before: Folded | None = None) -> Folded:
    """Add these runs, in their order, to the results so far."""
    folded = before or Folded()
    for reading in readings:
        folded = add_run(case_plan, folded, reading)
    return folded


def add_run(case_plan: CasePlan, folded: Folded, reading: Reading) -> Folded:
    """Add one more run to the results so far."""
    request, judge = reading.run.request, _RunJudge(case_plan, folded, reading)
    current = {check for check, digest in reading.run.program.items() if digest == case_plan.program.get(check)}
    # `--verify` wants a process for each check, so a run that shared one proves nothing to it.
    if not current or (case_plan.verify and len(request.limits) > 1):
        return folded
    folded = replace(folded, again=None, runs=(*folded.runs, reading.name))
    # A misleading check follows another one; with an outcome it compared the case with its specification.
    comparing = {reply.check for reply in reading.reply.checks if reply.check in MISLEADING and reply.outcome}
    replies = [reply for reply in reading.reply.checks if reply.check in request.limits.keys() | comparing]
    if not replies and reading.run.end.shot and not request.limits.keys() & folded.shot:
        return replace(folded, shot=folded.shot | request.limits.keys())
    ended = judge.ended(replies)
    lines = [one.record.decisive or "" for one in ended.values()]
    if TAKEN_AWAY in lines and not folded.taken_away:
        return replace(folded, again=request, taken_away=True)
    if any(map(CUT_SHORT.search, lines)) and not folded.recompiled:
        return replace(folded, again=replace(request, recompiled=True), recompiled=True)
    if request.confirms:
        return replace(folded, ended={**folded.ended, **_confirmed(folded, request, ended)})
    counting = current - request.limits.keys() if request.leads else current
    followers = [check for check in request.followers if check in counting]
    missed = {check for check in followers if not has_passed(ended.get(wire.leader_of(check)))}
    # A leading run stands for what it missed, too, or `todo` would ask for it for ever; `reusable` drops that again.
    followed = dict.fromkeys(followers if request.leads else set(followers) - missed, reading.name)
    ended = {check: one for check, one in ended.items() if check in counting}
    overran = {check for check, one in ended.items() if one.record.outcome is Outcome.TIMED_OUT} - folded.overran
    killed = {check for check, one in ended.items() if was_killed(one.record)} - folded.shot
    return replace(
        folded,
        ended={**folded.ended, **{name: one for name, one in ended.items() if name not in overran | killed}},
        followed={**folded.followed, **followed},
        missed=(folded.missed - followed.keys()) | (missed & followed.keys()),
        findings={**folded.findings, reading.name: judge.findings()},
        overran=folded.overran | overran,
        shot=folded.shot | killed,
    )


def _confirmed(folded: Folded, request: Request, ended: Mapping[str, Ended]) -> dict[str, Ended]:
    """Return the checks of a confirming run, each with whether it passed this time."""
    results = {}
    for check in request.limits:
        before, now = folded.ended.get(check), ended.get(check)
        if before:
            passed = now is not None and now.record.outcome is Outcome.PASSED
            results[check] = replace(before, passed_again=(*before.passed_again, passed))
    return results


class _RunJudge(Struct, frozen=True):
    """One run of a case, to be read."""

    case_plan: CasePlan
    folded: Folded
    reading: Reading

    def ended(self, replies: list[CheckReply]) -> dict[str, Ended]:
        """Return how each of these checks ended; if nothing was tried, the reason under the first one."""
        run = self.reading.run
        first = next(iter(run.request.limits))
        if not replies or self._python() != run.host.python:
            return {first: self._ended(self._not_tried(first))}
        results = [self._judged(reply) for reply in replies]
        if any(one.record.outcome in FAILING for one in results) and not run.host.stood:
            return {first: self._ended(CheckRecord(check=first, outcome=Outcome.INFRA, decisive=TAKEN_AWAY))}
        return {one.record.check: one for one in results}

    def _judged(self, reply: CheckReply) -> Ended:
        run = self.reading.run
        record = check_record(reply, ending_of(self.reading), run.host.undrawable)
        if reply.outcome is None:
            before = sum(check.seconds for check in self.reading.reply.checks)
            record = replace(record, seconds=round(run.end.seconds - before, 3))
        drawn = dict.fromkeys(name for shown, name in self.reading.reply.frames if shown == reply.check)
        return self._ended(record, self.reading.pictures(tuple(islice(drawn, MOST_FRAMES))))

    def _ended(self, record: CheckRecord, frames: tuple[str, ...] = ()) -> Ended:
        run = self.reading.run
        decisive = record.decisive and normalise(record.decisive, {})
        return Ended(
            record=replace(record, decisive=decisive),
            reading=self.reading.name,
            folder=self.reading.folder,
            measured=run.measured,
            conditions=run.host.conditions,
            attempts=2 if record.check in self.folded.overran | self.folded.shot else 1,
            frames=frames,
            peak_mb=run.end.peak_mb or None,
        )

    def _python(self) -> str:
        """Return the version of the Python that ran; a build from a checkout calls itself 3.14.0+."""
        return str(self.reading.reply.facts.get("python", "")).removesuffix("+")

    def _not_tried(self, check: str) -> CheckRecord:
        """Return why no package was tried: the probe ended before its first check, or another Python ran it.

        A package may still be at fault, if Python does not even start with what is installed.
        """
        run, reply = self.reading.run, self.reading.reply
        cause = SHOT if run.end.shot else run.end.killed or "; ".join(reply.problems) or self.reading.last_words
        decisive = f"the probe did not start: {cause}"
        if reply.checks:
            decisive = f"the environment's Python is {self._python()}, not {run.host.python}"
        if run.host.bare_start is None:
            return CheckRecord(check=check, outcome=Outcome.INFRA, decisive=decisive)
        if not run.host.stood:
            return CheckRecord(check=check, outcome=Outcome.INFRA, decisive=TAKEN_AWAY)
        return CheckRecord(check=check, outcome=Outcome.FAILED, decisive=run.host.bare_start)

    def findings(self) -> tuple[tuple[str | None, Finding], ...]:
        """Return all that the run found besides how its checks ended, each with the check that it was made during."""
        # This run only gives a trajectory to compare; the first run of the loop made the findings.
        if REPEAT in self.reading.run.request.limits:
            return ()
        end, reply = self.reading.run.end, self.reading.reply
        phase = phase_of(next(iter(self.reading.run.request.limits)))
        followers = self.reading.run.request.followers
        of_run = [*side_findings(reply, ending_of(self.reading), followers)]
        of_run += environment_findings(end.written, end.stray if reply.complete else 0, phase)
        lines = native_errors.errors(self.reading.printed)
        of_run += [Finding(check=f"{phase}.native", level=Level.WARNING, text=line) for line in lines]
        pairs = [*zip(reply.during, reply.findings, strict=True)]
        pairs += [(one.check if one.check in followers else None, one) for one in of_run]
        return tuple((during, replace(one, text=normalise(one.text, {}))) for during, one in pairs)


def environment_findings(written: tuple[str, ...], stray: int, phase: Phase) -> tuple[Finding, ...]:
    """Return the findings on what a run wrote into its environment, and on processes that it left behind."""
    findings = []
    if written:
        text = f"wrote into its own environment (kept from other runs): {', '.join(written[:MOST_WRITTEN])}"
        findings.append(Finding(check=f"{phase}.written", level=Level.WARNING, text=text))
    if stray:
        text = f"left {stray} process(es) behind at its end"
        findings.append(Finding(check=f"{phase}.stray", level=Level.WARNING, text=text))
    return tuple(findings)


def has_passed(ended: Ended | None) -> bool:
    """Return whether a check is known to have passed."""
    return ended is not None and ended.record.outcome is Outcome.PASSED


@cache
def wanted_of(checks: tuple[str, ...], until: Phase) -> Wanted:
    """Return the checks of each phase up to this one."""
    order = list(Phase)
    phases = [phase for phase in CASE_PHASES if order.index(phase) <= order.index(until)]
    by_phase = {phase: tuple(check for check in checks if phase_of(check) is phase) for phase in phases}
    return MappingProxyType({phase: names for phase, names in by_phase.items() if names})

"""One cell through its probes, given an environment: whoever owns the environment, the cell runs the same way.

One process serves a case's phases; after a death the rest goes on in a fresh one. Phases measured before under the
same key are not run again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice
from pathlib import Path
from secrets import token_hex
from types import MappingProxyType

from harness import bare_start, bytecode, frames, launch, misleading, nativesays, normalise, sources
from harness.hostile_data import Unreadable
from harness.judging import check as outcomes
from harness.model import (
    CASE_PHASES,
    FAILING,
    Case,
    CaseRecord,
    CheckRecord,
    CheckReply,
    Finding,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    Step,
)
from harness.store import Store, digest, now, write_atomic
from harness.verdict import worst
from harness.vocabulary import MISLEADING

DEFAULT_SECONDS = 120.0
MEASURED_AGAIN = frozenset({Outcome.INFRA, Outcome.UNAVAILABLE, Outcome.TIMED_OUT, Outcome.NOT_REACHED})
"""Outcomes that another run may change: never reused."""

Wanted = Mapping[Phase, tuple[str, ...]]
"""The checks of each phase."""

MOST_EVIDENCE, MOST_FRAMES = 16 << 20, 4
"""Bytes of text that are kept of one run, and frames of one check."""

RUNS_TO_CONFIRM = 3
LOOP, REPEAT, ACROSS = "single.loop", "single.repeat", "single.repeat.process"


@dataclass(frozen=True, kw_only=True, slots=True)
class Context:
    """What the cases of one cell share.

    `python` is the version that probes must find, `site` makes the environment when one really has to run. `identity`
    is all that a result's key holds besides case, phase and probe: environment key, variables, sandbox mode, machine.
    `conditions` marks the system: what failed under others is measured again, with `again` whatever failed. `measured`
    is what the whole run has measured so far, whatever came of it: that is never measured a second time.
    `undrawable` is why nothing can be drawn by OpenGL here (`machine.undrawable`), `places` names this machine's
    folders, for evidence.
    """

    store: Store
    python: str
    site: Callable[[], launch.Site]
    identity: tuple[object, ...]
    undrawable: Mapping[str, str]
    conditions: str | None
    places: Mapping[str, str]
    until: Phase = CASE_PHASES[-1]
    fresh: bool = False
    again: bool = False
    verify: bool = False
    measured: dict[str, PhaseRecord] = field(default_factory=dict)
    notify: Callable[[str], None] = lambda _: None


def run_case(context: Context, case: Case) -> CaseRecord:
    """Bring every phase of a case to an outcome, from stored results where they exist."""
    wanted = _wanted(case, context.until)
    known, missing = _stored(context, case, wanted)
    if missing:
        measured = _Measurement(context, case).phases(missing)
        for phase, record in measured.items():
            key = _key(context, case, phase, wanted[phase])
            context.measured[key] = record
            if record.outcome not in MEASURED_AGAIN:
                failed = record.outcome in FAILING
                kept = replace(record, conditions=context.conditions) if failed else record
                context.store.save_phase(key, kept)
        known |= measured
    return _reached(case, known)


def stored_case(context: Context, case: Case) -> CaseRecord | None:
    """The record of a case of which every phase is known; None where something has to be measured."""
    known, missing = _stored(context, case, _wanted(case, context.until))
    return None if missing else _reached(case, known)


def mark(context: Context, cases: Iterable[Case], lock: str | None) -> str:
    """Equal for two cells exactly when each record of the one, if it may be reused, is one of the other."""
    asked = [(case.id, case.required, _asked(case), _limits(case)) for case in cases]
    used = {(case.api, phase) for case in cases for phase in _wanted(case, context.until)}
    probes = [(api, phase, launch.probe_hash(api, phase)) for api, phase in sorted(used)]
    how = (context.verify, context.until, context.conditions, _judging())
    return digest("cell", context.identity, lock, asked, probes, how)


def reusable(cases: Iterable[CaseRecord]) -> bool:
    """Whether no phase came to an end that another run may change; one that was not reached has its reason before."""
    passing = MEASURED_AGAIN - {Outcome.NOT_REACHED}
    return not any(phase.outcome in passing for case in cases for phase in case.phases)


def claim(context: Context, case: Case) -> str:
    """Equal for two cases, of whatever cells, exactly when their measurement is one and the same."""
    return digest("case", context.identity, context.verify, _asked(case), _limits(case))


def not_reached(case: Case) -> CaseRecord:
    """The record of a case whose environment never came to be."""
    return _record(case, [_absent(phase, phase in _wanted(case, CASE_PHASES[-1])) for phase in CASE_PHASES])


def untold(case: Case, step: Step) -> CaseRecord:
    """The record of a case that could not be measured to its end, for a reason that says nothing about packages."""
    wanted = _wanted(case, CASE_PHASES[-1])
    first = next(iter(wanted), Phase.IMPORT)
    evidence = step.log and step.log.rpartition("/")[0]
    return _reached(
        case, {first: PhaseRecord(phase=first, outcome=step.outcome, decisive=step.decisive, evidence=evidence)}
    )


def _reached(case: Case, known: Mapping[Phase, PhaseRecord]) -> CaseRecord:
    asked = _wanted(case, CASE_PHASES[-1])
    return _record(case, [known.get(phase) or _absent(phase, phase in asked) for phase in CASE_PHASES])


def _record(case: Case, phases: Iterable[PhaseRecord]) -> CaseRecord:
    return CaseRecord(case=case.id, env=case.env, api=case.api, required=case.required, phases=tuple(phases))


def _wanted(case: Case, until: Phase) -> Wanted:
    return _by_phase(case.checks, until)


@cache
def _by_phase(checks: tuple[str, ...], until: Phase) -> Wanted:
    order = list(Phase)
    phases = [phase for phase in CASE_PHASES if order.index(phase) <= order.index(until)]
    found = {phase: tuple(check for check in checks if outcomes.phase_of(check) is phase) for phase in phases}
    return MappingProxyType({phase: names for phase, names in found.items() if names})


def _absent(phase: Phase, asked: bool) -> PhaseRecord:
    return PhaseRecord(phase=phase, outcome=Outcome.NOT_REACHED if asked else Outcome.SKIPPED)


def _key(context: Context, case: Case, phase: Phase, checks: tuple[str, ...]) -> str:
    limits = ({check: _limit(case, check) for check in checks}, case.memory_mb)
    probe = (launch.probe_hash(case.api, phase), _judging())
    return digest("phase", context.identity, context.verify, _asked(case), limits, phase, probe)


def _limits(case: Case) -> tuple[object, ...]:
    return case.checks, case.timeouts, case.memory_mb


def _asked(case: Case) -> tuple[object, ...]:
    drawn = sorted((case.picture or {}).items())
    modules = (case.imports, case.providers, case.beside)
    return case.env, case.api, case.kwargs, modules, drawn, case.steps, case.seed


def _judging() -> str:
    """Identify what turns a reply into an outcome: results judged in another way are measured again."""
    return sources.digest(__name__)


def _stored(context: Context, case: Case, wanted: Wanted) -> tuple[dict[Phase, PhaseRecord], Wanted]:
    """What is known of a case, and what of the rest can be reached."""
    found = {phase: _recall(context, _key(context, case, phase, checks)) for phase, checks in wanted.items()}
    known = {phase: replace(one, reused=True) for phase, one in found.items() if one}
    seen = {phase: record.outcome for phase, record in known.items()}
    missing = {phase: wanted[phase] for phase in wanted if phase not in known and outcomes.reachable(phase, seen)}
    return known, missing


def _recall(context: Context, key: str) -> PhaseRecord | None:
    """A phase as this run has measured it, else as it is stored, if that may be reused."""
    if key in context.measured:
        return context.measured[key]
    kept = None if context.fresh else context.store.load_phase(key)
    if kept and (kept.conditions not in {None, context.conditions} or (context.again and kept.outcome in FAILING)):
        return None
    return kept


def _limit(case: Case, check: str) -> float:
    return case.timeouts.get(outcomes.phase_of(check), DEFAULT_SECONDS)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Ended:
    """One check that ended, in whatever way, and what the run that showed it left behind."""

    record: CheckRecord
    attempts: int
    frames: tuple[str, ...] = ()
    evidence: str
    peak_mb: int | None = None


@dataclass(slots=True)
class _Measurement:
    """The checks of one case while they are being run."""

    context: Context
    case: Case
    ended: dict[str, _Ended] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    overran: set[str] = field(default_factory=set)
    shot: set[str] = field(default_factory=set)
    runs: int = 0
    token: str = field(default_factory=lambda: token_hex(4))
    compiled_anew: bool = False
    made_anew: bool = False

    def phases(self, wanted: Mapping[Phase, tuple[str, ...]]) -> dict[Phase, PhaseRecord]:
        """Run the checks of these phases and return what each phase came to."""
        checks = [check for names in wanted.values() for check in names]
        while pending := self._pending(checks):
            batch = pending[:1] if self.context.verify else pending
            self.ended |= self._run({check: self._seconds(check) for check in batch})
        if self.context.verify:
            self._confirm()
        if LOOP in self.ended and self.ended[LOOP].record.outcome is Outcome.PASSED:
            self._compare_processes(self.ended[LOOP].record)
        return {phase: self._phase(phase, names) for phase, names in wanted.items() if names[0] in self.ended}

    def _pending(self, checks: Iterable[str]) -> list[str]:
        known: dict[Phase, Outcome] = {}
        for check, ended in self.ended.items():
            phase = outcomes.phase_of(check)
            told = [one.outcome for one in misleading.settled([ended.record])]
            known[phase] = worst((*told, known.get(phase, Outcome.PASSED)))
        return [c for c in checks if c not in self.ended and outcomes.reachable(outcomes.phase_of(c), known)]

    def _seconds(self, check: str) -> float:
        return _limit(self.case, check) * (2 if check in self.overran else 1)

    def _run(self, limits: Mapping[str, float]) -> dict[str, _Ended]:
        """Run checks in one process; where that met bytecode that is not whole, once more without what was kept."""
        ended = self._run_once(limits)
        if not self.made_anew and any(e.record.decisive == launch.TAKEN_AWAY for e in ended.values()):
            self.made_anew = True
            ended = self._run_once(limits)
        if self.compiled_anew or not any(outcomes.CUT_SHORT.search(e.record.decisive or "") for e in ended.values()):
            return ended
        self.compiled_anew = True
        bytecode.forget(self.context.site().pycache)
        return self._run_once(limits)

    def _run_once(self, limits: Mapping[str, float]) -> dict[str, _Ended]:
        """Run checks in one process; those that were not started, or get a second try, are not in the answer."""
        for check in limits:
            self.context.notify(check)
        self.runs += 1
        asked = digest(self.context.identity, self.case.id, _asked(self.case), sorted(limits))[:16]
        name = f"{asked}-{self.token}-{self.runs}"  # a second measurement never lies among what the first one left
        site = self.context.site()
        with launch.probe(site, self.case, limits) as run:
            evidence = self._keep(run, name)
            replies = [reply for reply in run.reply.checks if reply.check in limits or _compared(reply)]
            self.findings += [] if REPEAT in limits else self._found(run, limits)
            if not replies and run.completed.shot and not limits.keys() & self.shot:
                self.shot |= limits.keys()
                return {}
            if not replies or self._python(run) != self.context.python:
                return {next(iter(limits)): self._not_tried(run, site, next(iter(limits)), evidence)}
            judged = [self._judged(run, reply, limits, evidence) for reply in replies]
        ended = {one.record.check: one for one in judged if one}
        if any(one.record.outcome in FAILING for one in ended.values()) and not site.stands():
            check = next(iter(limits))
            record = CheckRecord(check=check, outcome=Outcome.INFRA, decisive=launch.TAKEN_AWAY)
            return {check: _Ended(record=record, attempts=1, evidence=evidence)}
        return ended

    def _judged(
        self, run: launch.ProbeRun, reply: CheckReply, limits: Mapping[str, float], evidence: str
    ) -> _Ended | None:
        record = outcomes.check_record(reply, run.ending(), self.context.undrawable)
        if record.outcome is Outcome.TIMED_OUT and reply.check not in self.overran:
            self.overran.add(reply.check)
            return None
        if outcomes.shot(record) and reply.check not in self.shot:
            self.shot.add(reply.check)
            return None
        pictures = tuple(
            self.context.store.relative(picture)
            for content, picture in self._pictures(run, reply.check, evidence)
            if frames.keep(content, picture)
        )
        attempts = 2 if reply.check in self.overran | self.shot else 1
        if reply.outcome is None:
            before = sum(check.seconds for check in run.reply.checks)
            record = replace(record, seconds=round(run.completed.seconds - before, 3))
        if record.decisive:
            record = replace(record, decisive=self._clean(run, record.decisive))
        peak = run.completed.peak_mb or None
        return _Ended(record=record, attempts=attempts, frames=pictures, evidence=evidence, peak_mb=peak)

    def _python(self, run: launch.ProbeRun) -> str:
        """The version of the Python that ran; a build from a checkout calls itself 3.14.0+."""
        return str(run.reply.facts.get("python", "")).removesuffix("+")

    def _not_tried(self, run: launch.ProbeRun, site: launch.Site, check: str, evidence: str) -> _Ended:
        """The probe ended before its first check, or another Python ran it: no package was tried.

        One may be at fault all the same, where Python does not even start with it.
        """
        ended = outcomes.SHOT if run.completed.shot else run.completed.killed
        told = ended or "; ".join(run.reply.problems) or run.last_words()
        decisive = f"the probe did not start: {told}"
        if run.reply.checks:
            decisive = f"the environment's Python is {self._python(run)}, not {self.context.python}"
        outcome, done = Outcome.INFRA, run.completed
        if not (ended or run.reply.facts or done.timed_out or done.out_of_memory or run.full):
            broken = bare_start.broken_by_packages(site)
            if broken and not site.stands():
                decisive = launch.TAKEN_AWAY
            elif broken:
                outcome, decisive = Outcome.FAILED, broken
        record = CheckRecord(check=check, outcome=outcome, decisive=self._clean(run, decisive))
        return _Ended(record=record, attempts=1, evidence=evidence)

    def _pictures(self, run: launch.ProbeRun, check: str, evidence: str) -> Iterable[tuple[bytes, Path]]:
        """Yield the arrays that a check drew, at most two, each with the file that it is to be kept in."""
        drawn = dict.fromkeys(name for shown, name in run.reply.frames if shown == check)
        for name in islice(drawn, MOST_FRAMES):
            with suppress(Unreadable):
                content = run.left.head(name, frames.LARGEST + 1)
                yield content, self.context.store.folder / evidence / f"{Path(name).stem}.png"

    def _found(self, run: launch.ProbeRun, limits: Mapping[str, float]) -> list[Finding]:
        phase = outcomes.phase_of(next(iter(limits)))
        beside = outcomes.found_beside(run.reply, run.ending())
        found = [replace(told, text=self._clean(run, told.text)) for told in (*run.reply.findings, *beside)]
        if run.completed.written:
            files = ", ".join(run.completed.written[:5])
            text = f"wrote into its own environment (kept from other runs): {files}"
            found.append(Finding(check=f"{phase}.written", level=Level.WARNING, text=text))
        if run.completed.stray and run.reply.complete:
            text = f"left {run.completed.stray} process(es) behind at its end"
            found.append(Finding(check=f"{phase}.stray", level=Level.WARNING, text=text))
        printed = nativesays.errors(self._clean(run, run.printed()))
        return found + [Finding(check=f"{phase}.native", level=Level.WARNING, text=line) for line in printed]

    def _keep(self, run: launch.ProbeRun, name: str) -> str:
        """Keep the texts of a run, without this machine's paths."""
        folder = self.context.store.evidence(name)
        left = MOST_EVIDENCE
        for file, text in run.texts():
            content = self._clean(run, text[:left]).encode(errors="replace")
            write_atomic(folder / file, content)
            left = max(0, left - len(content))
        return self.context.store.relative(folder)

    def _clean(self, run: launch.ProbeRun, text: str) -> str:
        return normalise.normalise(text, {**self.context.places, **run.places})

    def _confirm(self) -> None:
        """Run each failed check again: one that also passes is flaky."""
        for check, ended in list(self.ended.items()):
            if ended.record.outcome not in FAILING or check in MISLEADING:
                continue
            again = [self._run({check: 2 * self._seconds(check)}).get(check, ended) for _ in range(RUNS_TO_CONFIRM - 1)]
            passed = sum(e.record.outcome is Outcome.PASSED for e in again)
            if passed:
                told = f"passed {passed} of {RUNS_TO_CONFIRM} runs; else: {ended.record.decisive}"
                record = replace(ended.record, outcome=Outcome.FLAKY, decisive=told)
                self.ended[check] = replace(ended, record=record, attempts=RUNS_TO_CONFIRM)

    def _compare_processes(self, loop: CheckRecord) -> None:
        """The same seed in a second process: another trajectory is a finding."""
        ended = self._run({REPEAT: 2 * _limit(self.case, LOOP)}).get(REPEAT)
        if ended is None:
            return
        first, second = loop.facts.get("trajectory"), ended.record.facts.get("trajectory")
        if ended.record.outcome in FAILING:
            text = f"the same loop in a second process: {ended.record.decisive}"
        elif ended.record.outcome is Outcome.PASSED and first != second:
            text = f"the same seed gives another trajectory in another process{_first_difference(first, second)}"
        else:
            return
        self.findings.append(Finding(check=ACROSS, level=Level.WARNING, text=text))

    def _phase(self, phase: Phase, names: tuple[str, ...]) -> PhaseRecord:
        comparisons = [name for name in self.ended if name in MISLEADING and outcomes.phase_of(name) is phase]
        ended = [self.ended[name] for name in (*names, *comparisons) if name in self.ended]
        counting = misleading.settled(e.record for e in ended)
        outcome = worst(record.outcome for record in counting)
        decisive = next((e for e in ended if e.record in counting and e.record.outcome is outcome), ended[0])
        findings = {(f.check, f.text): f for f in self.findings if f.check.partition(".")[0] == phase}
        return PhaseRecord(
            phase=phase,
            outcome=outcome,
            seconds=round(sum(e.record.seconds for e in ended), 3),
            decisive=decisive.record.decisive if decisive.record in counting else None,
            checks=tuple(_kept(e.record) for e in ended),
            findings=tuple(findings.values()),
            frames=tuple(picture for e in ended for picture in e.frames),
            evidence=decisive.evidence,
            attempts=max(e.attempts for e in ended),
            measured=now(),
            peak_mb=max((e.peak_mb for e in ended if e.peak_mb), default=None),
        )


def _compared(reply: CheckReply) -> bool:
    """Tell whether a check that follows another one compared the case with its specification."""
    return reply.check in MISLEADING and reply.outcome is not None


def _kept(record: CheckRecord) -> CheckRecord:
    """The record as it is stored: a trajectory is one text there, a fifth of the memory of its hundred digests."""
    steps = record.facts.get("trajectory")
    if not isinstance(steps, list) or not all(isinstance(step, str) for step in steps):
        return record
    return replace(record, facts={**record.facts, "trajectory": " ".join(steps)})


def _first_difference(first: object, second: object) -> str:
    if not isinstance(first, list) or not isinstance(second, list):
        return ""
    steps = [n for n, (one, other) in enumerate(zip(first, second, strict=False)) if one != other]
    return f", from step {steps[0]} on" if steps else ""

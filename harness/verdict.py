"""Judges evidence: one pure function from what was measured of a cell to what that means.

Evidence is stored and verdicts are computed, so that old results can be judged again. What could not be measured is
never guessed: where infra trouble hit, the cell is judged twice, once as if everything so hit had passed and once as
if it had failed, and it is `inconclusive` unless both say the same. A failure that the adapter's control shares counts
as such trouble.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache

from harness import misleading
from harness.exercised import idle, lacking, nothing_of
from harness.model import (
    CASE_PHASES,
    FAILING,
    Case,
    CaseRecord,
    Cell,
    CellRecord,
    Expectation,
    Level,
    Outcome,
    Phase,
    PhaseRecord,
    Step,
    Verdict,
)
from harness.reporttypes import SEVERITY, UNTOLD, ExpectationEntry
from harness.standalone.silent import plainly_good
from harness.trust import trusted
from harness.vocabulary import MISLEADING

RANK = {outcome: place for place, outcome in enumerate(Outcome)}
"""The worst is 0."""

ONLY_IMPORT = "only the import was tried"

AFTER_IMPORT = frozenset({Verdict.PARTIAL, Verdict.BROKEN})

Outcomes = Mapping[Phase, Outcome]


@dataclass(frozen=True, kw_only=True, slots=True)
class Judgement:
    """What the evidence means. `phase` is the first that decided it, `decisive` the line that says why.

    `unverified` names the phases that a working cell could not show in every case.
    """

    verdict: Verdict
    phases: Outcomes
    phase: Phase | None = None
    decisive: str | None = None
    unverified: tuple[str, ...] = ()


def judge(evidence: CellRecord) -> Judgement:
    """Apply the table of DESIGN section 5: the first row that fits wins."""
    cases = tuple(case_phases(evidence, record) for record in _all_cases(evidence))
    suite = suite_phase(evidence)
    phases = _cell_phases(evidence, cases, suite)
    verdict = _verdict(evidence, cases, suite)
    needed = lacking(evidence) if evidence.cell.asked and verdict in AFTER_IMPORT else None
    if needed:
        return Judgement(verdict=Verdict.NOT_RUN, phases=phases, decisive=needed)
    missed = idle(evidence)
    if missed and (verdict is Verdict.WORKS or (verdict in AFTER_IMPORT and len(missed) == len(evidence.cell.asked))):
        return Judgement(verdict=Verdict.NOT_RUN, phases=phases, decisive=nothing_of(missed, evidence))
    phase, decisive = _shown(cases) if verdict is Verdict.MISLEADS else _decided_by(verdict, evidence, cases, suite)
    if verdict is Verdict.NOT_RUN and phases[Phase.IMPORT] is Outcome.PASSED:
        decisive = _tried_alone(phases)
        if suite and suite_not_run(suite):
            decisive += f"; its tests were not run: {suite.decisive}"
    return Judgement(
        verdict=verdict,
        phases=phases,
        phase=phase,
        decisive=decisive,
        unverified=_unverified(cases, suite) if verdict is Verdict.WORKS else (),
    )


def fulfilled(verdict: Verdict, phases: Outcomes, unverified: Iterable[str] = ()) -> bool:
    """Return whether a cell is plainly good, or at least does all that was asked for: import alone never `works`."""
    asked = {outcome for outcome in phases.values() if outcome is not Outcome.SKIPPED}
    imports = phases.get(Phase.IMPORT) is Outcome.PASSED and asked == {Outcome.PASSED}
    return plainly_good(verdict, unverified) or (verdict is Verdict.NOT_RUN and imports)


def _tried_alone(phases: Outcomes) -> str:
    """What was tried of a cell in which no environment went through `single`, without which nothing works."""
    others = [phase for phase in (Phase.VECTOR, Phase.RENDER, Phase.INTEROP) if phases.get(phase) is Outcome.PASSED]
    left_out = phases[Phase.SINGLE] is Outcome.SKIPPED
    return f"{' and '.join(others)} passed, but {Phase.SINGLE} was not tried" if others and left_out else ONLY_IMPORT


def suite_phase(evidence: CellRecord) -> PhaseRecord | None:
    """How the subject's own suite ended; None where the cell has none to run."""
    asked = evidence.cell.subject is not None and evidence.cell.subject.suite is not None
    return (evidence.suite or PhaseRecord(phase=Phase.SUITE, outcome=Outcome.NOT_REACHED)) if asked else None


def suite_not_run(suite: PhaseRecord) -> bool:
    """Return whether tests that were asked for could not be run, their environment being impossible to make."""
    return suite.outcome is Outcome.NOT_REACHED and suite.decisive is not None


def case_phases(evidence: CellRecord, record: CaseRecord) -> tuple[PhaseRecord, ...]:
    """The phases of a case as they count, all of `CASE_PHASES`: with `required` findings, and none left unsaid.

    A failure in which the control of the adapter shares is `infra`: whose fault it is cannot be told.
    """
    known = {phase.phase: phase for phase in record.phases}
    cases = evidence.cell.cases
    asked = _asked(tuple(check for case in cases if case.id == record.case for check in case.checks))
    counted = (_counted(phase, known.get(phase), asked[phase], record.required) for phase in CASE_PHASES)
    return tuple(trusted(phase, evidence.controls.get(record.api)) for phase in counted)


@cache
def _asked(checks: tuple[str, ...]) -> Mapping[Phase, frozenset[str]]:
    return {phase: frozenset(one for one in checks if one.partition(".")[0] == phase) for phase in CASE_PHASES}


def counts(record: PhaseRecord) -> bool:
    """Whether a phase is told of: always, except the last one where nothing of it was asked for."""
    return record.phase is not CASE_PHASES[-1] or record.outcome is not Outcome.SKIPPED or bool(record.checks)


def effective(record: PhaseRecord, required: Iterable[str]) -> PhaseRecord:
    """The record of a phase, failed where a check that the case requires gave a warning."""
    names = frozenset(required)
    broken = [found for found in record.findings if found.check in names and found.level is Level.WARNING]
    if not broken or record.outcome in FAILING:
        return record
    return replace(record, outcome=Outcome.FAILED, decisive=f"{broken[0].check}: {broken[0].text}")


def misleads(case: Iterable[PhaseRecord]) -> tuple[str, ...]:
    """Return the checks by which a case, given by its phases, contradicts its own specification."""
    return tuple(check.check for phase in case for check in misleading.shown(phase.checks))


def worst(outcomes: Iterable[Outcome]) -> Outcome:
    """The first in the order of `Outcome`, which is worst first; `skipped` of nothing."""
    return min(outcomes, key=RANK.__getitem__, default=Outcome.SKIPPED)


# --- the table -------------------------------------------------------------------------------------------------


def _verdict(evidence: CellRecord, cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Verdict:
    resolve, install = _step(evidence.resolve), _step(evidence.install)
    if install in FAILING and resolve not in FAILING:
        return Verdict.UNINSTALLABLE
    for outcome, failed in ((resolve, Verdict.UNRESOLVABLE), (install, Verdict.UNINSTALLABLE)):
        match outcome:
            case Outcome.PASSED | Outcome.SKIPPED:
                continue
            case Outcome.INFRA:
                return Verdict.INCONCLUSIVE
            case Outcome.UNAVAILABLE:
                return Verdict.UNAVAILABLE
            case Outcome.NOT_REACHED | None:
                return Verdict.UNAVAILABLE if evidence.unavailable else Verdict.NOT_RUN
            case Outcome.FAILED | Outcome.CRASHED | Outcome.TIMED_OUT | Outcome.FLAKY:
                return failed
    return _installed(cases, suite)


def _installed(cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Verdict:
    """Return the verdict of an installed cell; a case that misleads decides it whatever infra trouble hit others."""
    best, poorest = (
        _probed([_had(case, outcome) for case in cases], _had([suite] if suite else [], outcome))
        for outcome in (Outcome.PASSED, Outcome.FAILED)
    )
    if Verdict.IMPORT_FAILS not in {best, poorest} and any(misleads(case) for case in cases):
        return Verdict.MISLEADS
    return best if best is poorest else Verdict.INCONCLUSIVE


def _step(step: Step | None) -> Outcome | None:
    """How a step on the host ended; a resolution that timed out says nothing about packages."""
    if step and step.phase is Phase.RESOLVE and step.outcome is Outcome.TIMED_OUT:
        return Outcome.INFRA
    return step.outcome if step else None


def _had(case: Sequence[PhaseRecord], infra: Outcome) -> Outcomes:
    """The case as it would stand had each infra phase ended `infra`, and with it all that it kept from running.

    In the same way what an unavailable phase kept from running is unavailable.
    """
    imagined: dict[Phase, Outcome] = {}
    cause: Outcome | None = None
    for record in case:
        outcome = record.outcome
        if outcome is Outcome.INFRA:
            cause = outcome = infra
        elif outcome is Outcome.UNAVAILABLE:
            cause = cause or outcome
        elif outcome is Outcome.NOT_REACHED and cause:
            outcome = cause
        imagined[record.phase] = outcome
    return imagined


def _probed(cases: Sequence[Outcomes], suite: Outcomes) -> Verdict:
    """The verdict of an installed cell without infra trouble.

    A suite that passed shows as much as a `single` where no case asks for one: in a cell without environments.
    """
    imports = {case[Phase.IMPORT] for case in cases}
    single = {case[Phase.SINGLE] for case in cases}
    after = {outcome for case in cases for phase, outcome in case.items() if phase is not Phase.IMPORT}
    after |= {*suite.values()}
    if (imports | after) & FAILING:
        if Outcome.PASSED in after:
            return Verdict.PARTIAL
        untried = {Outcome.UNAVAILABLE, Outcome.NOT_REACHED}
        return Verdict.IMPORT_FAILS if imports & FAILING and imports <= FAILING | untried else Verdict.BROKEN
    shown = single - {Outcome.SKIPPED} or {*suite.values()}
    if Outcome.PASSED in shown and Outcome.NOT_REACHED not in shown:
        return Verdict.WORKS
    return Verdict.UNAVAILABLE if Outcome.UNAVAILABLE in imports | after else Verdict.NOT_RUN


# --- what counts, and what decided -----------------------------------------------------------------------------


def _all_cases(evidence: CellRecord) -> tuple[CaseRecord, ...]:
    """The cases with a record, and an empty one for each that the cell should have had."""
    known = {record.case for record in evidence.cases}
    return (*evidence.cases, *(_unseen(case) for case in evidence.cell.cases if case.id not in known))


def _unseen(case: Case) -> CaseRecord:
    return CaseRecord(case=case.id, env=case.env, api=case.api, required=case.required, phases=())


def _counted(phase: Phase, record: PhaseRecord | None, asked: Set[str], required: tuple[str, ...]) -> PhaseRecord:
    """Tell a phase without meaning (skipped, and a check says so) from one of which a check was asked and left out."""
    if record is None:
        return PhaseRecord(phase=phase, outcome=Outcome.NOT_REACHED if asked else Outcome.SKIPPED)
    told = effective(record, required)
    left_out = asked - MISLEADING - {check.check for check in record.checks}
    if left_out and told.outcome in {Outcome.PASSED, Outcome.SKIPPED}:
        return replace(told, outcome=Outcome.NOT_REACHED)
    return told


def _cell_phases(evidence: CellRecord, cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Outcomes:
    unreached = Outcome.UNAVAILABLE if evidence.unavailable else Outcome.NOT_REACHED
    resolve = _step(evidence.resolve) or unreached
    install = _step(evidence.install) or (unreached if resolve is Outcome.PASSED else Outcome.NOT_REACHED)
    phases = {Phase.RESOLVE: resolve, Phase.INSTALL: install}
    for number, phase in enumerate(CASE_PHASES):
        phases[phase] = worst(case[number].outcome for case in cases) if cases else Outcome.NOT_REACHED
    if not any(counts(case[-1]) for case in cases):
        phases.pop(Phase.INTEROP, None)
    if suite:
        phases[Phase.SUITE] = suite.outcome
    return phases


def _deciding(verdict: Verdict) -> frozenset[Outcome]:
    """The outcomes that make this verdict what it is."""
    match verdict:
        case Verdict.WORKS | Verdict.NOT_RUN | Verdict.MISLEADS:
            return frozenset()
        case Verdict.INCONCLUSIVE:
            return frozenset({Outcome.INFRA})
        case Verdict.UNAVAILABLE:
            return frozenset({Outcome.UNAVAILABLE})
        case Verdict.UNRESOLVABLE | Verdict.UNINSTALLABLE | Verdict.IMPORT_FAILS | Verdict.PARTIAL | Verdict.BROKEN:
            return FAILING


def _shown(cases: Iterable[Iterable[PhaseRecord]]) -> tuple[Phase, str | None]:
    """Return the first phase, and in it the first case, in which a case contradicts its own specification."""
    found = ((phase, check) for case in cases for phase in case for check in misleading.shown(phase.checks))
    phase, check = min(found, key=lambda pair: CASE_PHASES.index(pair[0].phase))
    return phase.phase, check.decisive


def _decided_by(
    verdict: Verdict,
    evidence: CellRecord,
    cases: Sequence[Sequence[PhaseRecord]],
    suite: PhaseRecord | None,
) -> tuple[Phase | None, str | None]:
    """Return the first phase, and in it the first case, whose outcome makes the verdict, and the line that says why."""
    deciding = _deciding(verdict)
    steps = [(step.phase, _step(step), step.decisive) for step in (evidence.resolve, evidence.install) if step]
    missing = Phase.INSTALL if evidence.resolve else Phase.RESOLVE
    probes = [(record.phase, record.outcome, reason(record)) for phase in zip(*cases, strict=True) for record in phase]
    last = [(suite.phase, suite.outcome, reason(suite))] if suite else []
    for phase, outcome, why in steps + probes + last:
        if outcome in deciding:
            return phase, why
    return (missing, evidence.unavailable) if Outcome.UNAVAILABLE in deciding else (None, None)


def reason(record: PhaseRecord) -> str | None:
    """Why a phase ended as it did: its own line, or that of its first check that ended so."""
    own = (check.decisive for check in misleading.settled(record.checks) if check.outcome is record.outcome)
    return record.decisive or next((line for line in own if line), None)


def _unverified(cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> tuple[str, ...]:
    open_ends = {Outcome.UNAVAILABLE, Outcome.NOT_REACHED}
    told = [record for case in cases for record in case] + ([suite] if suite else [])
    found = {record.phase for record in told if record.outcome in open_ends}
    return tuple(phase.value for phase in (*CASE_PHASES, Phase.SUITE) if phase in found)


# --- against what was expected ---------------------------------------------------------------------------------


def expected(
    cell: Cell, judgement: Judgement, today: str, causes: Collection[str] = ()
) -> tuple[bool | None, str | None]:
    """Whether the cell is as expected (None where nothing can be said), and why its expectation is stale, if it is.

    `today` is an ISO date or instant, `causes` are the known failures that fit it, by id. A cell without expectation is
    expected to work.
    """
    expect = cell.expect
    told = judgement.verdict not in UNTOLD and not (cell.tried and cell.tried.proving)
    if expect is None:
        return (judgement.verdict is Verdict.WORKS if told else None), None
    met = fits(expect, judgement, causes) if told else None
    return met, outdated(cell.id, judgement.verdict, expect, today)


def fits(expect: Expectation | ExpectationEntry, judgement: Judgement, causes: Collection[str]) -> bool:
    """Whether a judgement, with the known failures that fit it, is what was expected."""
    return (
        judgement.verdict is expect.verdict
        and expect.phase in {None, judgement.phase}
        and (expect.match is None or re.search(expect.match, judgement.decisive or "") is not None)
        and (expect.signature is None or expect.signature in causes)
    )


def outdated(cell_id: str, verdict: Verdict, expect: Expectation | ExpectationEntry, today: str) -> str | None:
    """Why the expectation of a cell is stale: the cell does better, or its time has passed."""
    if verdict not in UNTOLD and SEVERITY.index(verdict) > SEVERITY.index(expect.verdict):
        return f"{cell_id} does better than expected: {verdict} instead of {expect.verdict}"
    if passed(expect, today):
        return f"{cell_id} was expected to be {expect.verdict} until {expect.until}, which has passed"
    return None


def passed(expect: Expectation | ExpectationEntry, today: str) -> bool:
    """Whether the last day of an expectation is over."""
    return bool(expect.until) and today[:10] > str(expect.until)[:10]


def exit_code(judged: Iterable[tuple[Verdict, bool | None]], *, stale: bool, fail_on: Collection[str]) -> int:
    """The exit code of verdicts with their `as_expected`: 1 before 3 before 0.

    `fail_on` names verdicts that are to fail whatever was expected, `unexpected` for what is not as expected, and
    `stale` for expectations out of date.
    """
    known = tuple(judged)
    unexpected = "unexpected" in fail_on and any(right is False for _, right in known)
    if unexpected or (stale and "stale" in fail_on) or any(verdict in fail_on for verdict, _ in known):
        return 1
    return 3 if any(verdict is Verdict.INCONCLUSIVE for verdict, _ in known) else 0

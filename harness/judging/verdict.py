"""Judge evidence: one pure function from the measurements of a cell to their meaning.

Evidence is stored and verdicts are computed, so that old results can be judged again. Nothing is guessed: if infra
trouble hit, the cell is judged twice, once as if everything hit had passed and once as if it had failed. It is
`inconclusive` unless both agree. A failure that the adapter's control shares counts as such trouble.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from msgspec import Struct

from harness.judging.counted_phases import (
    ON_REQUEST,
    Cases,
    counts,
    find_observation,
    reason,
    step_outcome,
    suite_not_run,
    suite_phase,
)
from harness.judging.exercised import ONLY_IMPORT, idle, missing_arguments, nothing_of
from harness.judging.runs import misleading
from harness.model import CASE_PHASES, FAILING, CellRecord, Observation, Outcome, Phase, PhaseRecord, Verdict, worst

AFTER_IMPORT = frozenset({Verdict.PARTIAL, Verdict.BROKEN})

Outcomes = Mapping[Phase, Outcome]


class Judgement(Struct, frozen=True, kw_only=True):
    """The meaning of evidence. `phase` is the first that decided it, `decisive` the line that says why.

    `observed` is the cell's observation behind that line, if the line is ours. `unverified` names the phases that a
    working cell could not show in every case.
    """

    verdict: Verdict
    phases: Outcomes
    phase: Phase | None = None
    decisive: str | None = None
    unverified: tuple[str, ...] = ()
    observed: Observation | None = None


def judge(evidence: CellRecord, cases: Cases) -> Judgement:
    """Apply the table of DESIGN section 5: the first row that fits wins. `cases` are from `counted_cases`."""
    suite = suite_phase(evidence)
    phases = _cell_phases(evidence, cases, suite)
    verdict = _verdict(evidence, cases, suite)
    needed = missing_arguments(evidence) if evidence.cell.asked and verdict in AFTER_IMPORT else None
    if needed:
        return Judgement(verdict=Verdict.NOT_RUN, phases=phases, decisive=needed)
    missed = idle(evidence)
    # Every package that is asked for has to run before a cell works; for a failure to count, one that ran is enough.
    if missed and (verdict is Verdict.WORKS or (verdict in AFTER_IMPORT and len(missed) == len(evidence.cell.asked))):
        return Judgement(verdict=Verdict.NOT_RUN, phases=phases, decisive=nothing_of(missed, evidence))
    phase, decisive = (
        _find_contradiction(cases) if verdict is Verdict.MISLEADS else _decided_by(verdict, evidence, cases, suite)
    )
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
        observed=next((seen for case in cases for one in case if (seen := find_observation(one, decisive))), None),
    )


def _tried_alone(phases: Outcomes) -> str:
    """Name the phases tried in a cell where no environment went through `single`, without which nothing works."""
    others = [
        phase for phase in (Phase.VECTOR, Phase.RENDER, *sorted(ON_REQUEST)) if phases.get(phase) is Outcome.PASSED
    ]
    left_out = phases[Phase.SINGLE] is Outcome.SKIPPED
    return f"{' and '.join(others)} passed, but {Phase.SINGLE} was not tried" if others and left_out else ONLY_IMPORT


# --- the table -------------------------------------------------------------------------------------------------


def _verdict(evidence: CellRecord, cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Verdict:
    resolve, install = step_outcome(evidence.resolve), step_outcome(evidence.install)
    # A build may fail while the cell is resolved: then there is an install step, but no resolve step.
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
    return _judge_installed(cases, suite)


def _judge_installed(cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Verdict:
    """Return the verdict of an installed cell; a case that misleads decides it whatever infra trouble hit others."""
    best, poorest = (
        _judge_probes(
            [_imagine_outcomes(case, outcome) for case in cases], _imagine_outcomes([suite] if suite else [], outcome)
        )
        for outcome in (Outcome.PASSED, Outcome.FAILED)
    )
    if Verdict.IMPORT_FAILS not in {best, poorest} and any(
        misleading.find(phase.checks) for case in cases for phase in case
    ):
        return Verdict.MISLEADS
    return best if best is poorest else Verdict.INCONCLUSIVE


def _imagine_outcomes(case: Sequence[PhaseRecord], infra: Outcome) -> Outcomes:
    """Return the outcomes of a case as if each infra phase, and all phases that it blocked, had ended as `infra`.

    In the same way, phases that an unavailable phase blocked are unavailable.
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


def _judge_probes(cases: Sequence[Outcomes], suite: Outcomes) -> Verdict:
    """Return the verdict of an installed cell without infra trouble.

    If no case asks for `single`, as in a cell without environments, a passed suite shows as much.
    """
    imports = {case[Phase.IMPORT] for case in cases}
    single = {case[Phase.SINGLE] for case in cases}
    after = {outcome for case in cases for phase, outcome in case.items() if phase is not Phase.IMPORT}
    after |= {*suite.values()}
    if (imports | after) & FAILING:
        # A passed import is nothing that works: only what comes after it makes a cell partial.
        if Outcome.PASSED in after:
            return Verdict.PARTIAL
        untried = {Outcome.UNAVAILABLE, Outcome.NOT_REACHED}
        return Verdict.IMPORT_FAILS if imports & FAILING and imports <= FAILING | untried else Verdict.BROKEN
    shown = single - {Outcome.SKIPPED} or {*suite.values()}
    if Outcome.PASSED in shown and Outcome.NOT_REACHED not in shown:
        return Verdict.WORKS
    return Verdict.UNAVAILABLE if Outcome.UNAVAILABLE in imports | after else Verdict.NOT_RUN


# --- what counts, and what decided -----------------------------------------------------------------------------


def _cell_phases(evidence: CellRecord, cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> Outcomes:
    unreached = Outcome.UNAVAILABLE if evidence.unavailable else Outcome.NOT_REACHED
    resolve = step_outcome(evidence.resolve) or unreached
    install = step_outcome(evidence.install) or (unreached if resolve is Outcome.PASSED else Outcome.NOT_REACHED)
    phases = {Phase.RESOLVE: resolve, Phase.INSTALL: install}
    for number, phase in enumerate(CASE_PHASES):
        phases[phase] = worst(case[number].outcome for case in cases) if cases else Outcome.NOT_REACHED
        if phase in ON_REQUEST and not any(counts(case[number]) for case in cases):
            del phases[phase]
    if suite:
        phases[Phase.SUITE] = suite.outcome
    return phases


def _deciding(verdict: Verdict) -> frozenset[Outcome]:
    """Return the outcomes that lead to this verdict."""
    match verdict:
        case Verdict.WORKS | Verdict.NOT_RUN | Verdict.MISLEADS:
            return frozenset()
        case Verdict.INCONCLUSIVE:
            return frozenset({Outcome.INFRA})
        case Verdict.UNAVAILABLE:
            return frozenset({Outcome.UNAVAILABLE})
        case Verdict.UNRESOLVABLE | Verdict.UNINSTALLABLE | Verdict.IMPORT_FAILS | Verdict.PARTIAL | Verdict.BROKEN:
            return FAILING


def _find_contradiction(cases: Iterable[Iterable[PhaseRecord]]) -> tuple[Phase, str | None]:
    """Return the first phase, and in it the first case, in which a case contradicts its own specification."""
    contradictions = ((phase, check) for case in cases for phase in case for check in misleading.find(phase.checks))
    phase, check = min(contradictions, key=lambda pair: CASE_PHASES.index(pair[0].phase))
    return phase.phase, check.decisive


def _decided_by(
    verdict: Verdict,
    evidence: CellRecord,
    cases: Sequence[Sequence[PhaseRecord]],
    suite: PhaseRecord | None,
) -> tuple[Phase | None, str | None]:
    """Return the first phase, and in it the first case, whose outcome makes the verdict, and the line that says why."""
    deciding = _deciding(verdict)
    steps = [(step.phase, step_outcome(step), step.decisive) for step in (evidence.resolve, evidence.install) if step]
    missing = Phase.INSTALL if evidence.resolve else Phase.RESOLVE
    probes = [(record.phase, record.outcome, reason(record)) for phase in zip(*cases, strict=True) for record in phase]
    last = [(suite.phase, suite.outcome, reason(suite))] if suite else []
    for phase, outcome, why in steps + probes + last:
        if outcome in deciding:
            return phase, why
    return (missing, evidence.unavailable) if Outcome.UNAVAILABLE in deciding else (None, None)


def _unverified(cases: Sequence[Sequence[PhaseRecord]], suite: PhaseRecord | None) -> tuple[str, ...]:
    open_ends = {Outcome.UNAVAILABLE, Outcome.NOT_REACHED}
    records = [record for case in cases for record in case] + ([suite] if suite else [])
    open_phases = {record.phase for record in records if record.outcome in open_ends}
    return tuple(phase.value for phase in (*CASE_PHASES, Phase.SUITE) if phase in open_phases)

"""Run one cell through its probes in a given environment: the same way, whoever owns the environment.

A case is judged again from the runs that the vault holds. Missing runs are made one by one, as long as judging asks for
one more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from threading import Lock

from msgspec import Struct

from harness.judging.runs.case import case_record, phases
from harness.judging.runs.fold import MEASURED_AGAIN, REPEAT, CasePlan, Folded, add_run, fold, wanted_of
from harness.judging.runs.todo import todo
from harness.machine import process, source_digests
from harness.machine.store import digest, load_or_make
from harness.model import CASE_PHASES, Case, CaseRecord, Outcome, Phase, PhaseRecord, Step
from harness.probes import program
from harness.probes.measure import Laboratory
from harness.probes.wire import followers_of
from harness.standalone.adapters import encode_declarations

JUDGING = ("harness.judging.runs.case", "harness.judging.runs.todo")


class Context(Struct, frozen=True, kw_only=True):
    """The parts that the cases of one cell share.

    `laboratory` runs the probes and keeps what they show. `identity` is all that a key holds besides the case:
    environment key, variables, sandbox mode, machine. Failures under other conditions than those of the host are
    measured again, with `again` all failures, with `fresh` everything. `measured` has the runs of this process by their
    key: whatever came of them, none is made a second time.
    """

    laboratory: Laboratory
    identity: tuple[object, ...]
    until: Phase = CASE_PHASES[-1]
    fresh: bool = False
    again: bool = False
    verify: bool = False
    measured: dict[str, tuple[str, ...]] = {}
    notify: Callable[[str], None] = lambda _: None

    def plan_case(self, case: Case) -> CasePlan:
        """Return the checks that are wanted of a case, with the digests of their programs."""
        wanted = wanted_of(case.checks, self.until)
        checks = [check for names in wanted.values() for check in names]
        # Judging may ask for followers and REPEAT later: their runs count only if their digests are known here.
        names = (*checks, *followers_of(checks), REPEAT)
        digests = {name: program.digest(case.api, name) for name in names}
        return CasePlan(case=case, wanted=wanted, program=digests, verify=self.verify)


def run_case(context: Context, case: Case) -> CaseRecord:
    """Bring every phase of a case to an outcome, from stored runs where they exist."""
    case_plan, key, new = context.plan_case(case), claim(context, case), set()
    folded = _fold_runs(context, case_plan, key)
    while request := todo(case_plan, folded):
        for check in request.limits:
            context.notify(check)
        name = context.laboratory.measure(request, key)
        new.add(name)
        context.measured[key] = (*context.measured.get(key, ()), name)
        folded = add_run(case_plan, folded, context.laboratory.vault.reading(name))
    return case_record(case, phases(case_plan, folded, frozenset(new)), folded.runs)


def stored_case(context: Context, case: Case) -> CaseRecord | None:
    """Return the record of a case of which every phase is known; None where something has to be measured."""
    case_plan = context.plan_case(case)
    folded = _fold_runs(context, case_plan, claim(context, case))
    return None if todo(case_plan, folded) else case_record(case, phases(case_plan, folded), folded.runs)


def _fold_runs(context: Context, case_plan: CasePlan, key: str) -> Folded:
    """Fold the stored runs that may be reused, and the runs of this process whatever their results; return the fold."""
    vault, mine = context.laboratory.vault, context.measured.get(key, ())
    before = () if context.fresh else [name for name in vault.runs(key) if name not in mine]
    # Versions before 0.1 kept runs that the user's stop had ended.
    whole = (reading for reading in vault.readings(before) if reading.run.end.killed != process.INTERRUPTED)
    folded = fold(case_plan, whole)
    folded = folded.reusable(context.laboratory.host.conditions, failed_too=not context.again)
    # Added after `reusable`, which would drop a time-out of this process and have it measured a second time.
    return fold(case_plan, vault.readings(mine), folded)


def mark(context: Context, cases: Iterable[Case], lock: str | None) -> str:
    """Return a mark that is equal for two cells exactly when each reusable record of one is a record of the other.

    The record of a cell is a memo of its judgement: other judging code judges the cell again.
    """
    case_keys = [(case.id, case.required, _case_inputs(case), _limits(case), case.checks) for case in cases]
    programs = [sorted(context.plan_case(case).program.items()) for case in cases]
    # Conditions count, since failures hold only for the system that they were measured on (`Folded.reusable`).
    how = (context.verify, context.until, context.laboratory.host.conditions)
    return digest("cell", context.identity, lock, case_keys, programs, how, _judging())


def _judging() -> tuple[str, ...]:
    """Identify the judging code: its sources, and the declarations of adapters. One thread reads, however many ask."""
    with _reading:
        return _read_judging()


_reading = Lock()


@cache
def _read_judging() -> tuple[str, ...]:
    # The declarations lie in files of `incell/`, which no judging module imports: the digests do not cover them.
    mark = digest("judging", source_digests.stat_files())
    code = load_or_make("judging", mark, lambda: digest(*map(source_digests.digest, JUDGING)).encode(), bytes.decode)
    return code, encode_declarations().decode()


def reusable(cases: Iterable[CaseRecord]) -> bool:
    """Return whether no phase has an outcome that another run may change.

    A phase that was not reached does not count: an earlier phase has its reason.
    """
    passing = MEASURED_AGAIN - {Outcome.NOT_REACHED}
    return not any(phase.outcome in passing for case in cases for phase in case.phases)


def claim(context: Context, case: Case) -> str:
    """Return a key that is equal for two cases, of whatever cells, exactly when one run can answer for both.

    The in-cell program is no part of it: a run says which one it ran, check by check. Nor is anything that judges.
    """
    return digest("case", context.identity, _case_inputs(case), _limits(case))


def not_reached(case: Case) -> CaseRecord:
    """Return the record of a case whose environment never came to be."""
    return case_record(case, {})


def inconclusive_record(case: Case, step: Step) -> CaseRecord:
    """Return the record of a case that could not be measured to its end, for a reason unrelated to packages."""
    first = next(iter(wanted_of(case.checks, CASE_PHASES[-1])), Phase.IMPORT)
    evidence = step.log and step.log.rpartition("/")[0]
    record = PhaseRecord(phase=first, outcome=step.outcome, decisive=step.decisive, evidence=evidence)
    return case_record(case, {first: record})


def _limits(case: Case) -> tuple[object, ...]:
    return sorted(case.timeouts.items()), case.memory_mb


def _case_inputs(case: Case) -> tuple[object, ...]:
    drawn = sorted((case.picture or {}).items())
    modules = (case.imports, case.providers, case.beside)
    bank = (case.bank,) if case.bank else ()  # the keys of cases without a bank stay what they were
    policy = (case.policy,) if case.policy else ()
    return case.env, case.api, case.kwargs, modules, drawn, case.steps, case.seed, *bank, *policy

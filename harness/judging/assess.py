"""Assess a cell: the only way from its record and the known failures to a verdict, and to all that follows from it.

Slow parts are computed on first use: signatures are read only if something failed, silent ones only if something was
installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from harness.judging import expectation, failure_texts, identity, known_failures
from harness.judging.assessed_case import AssessedCase
from harness.judging.counted_phases import Cases, counted_cases, suite_not_run, suite_phase
from harness.judging.identity import Failure
from harness.judging.known_failures import NOTHING_KNOWN, Knowledge
from harness.judging.verdict import Judgement, Outcomes, judge
from harness.matrix.signatures import Signature
from harness.model import CASE_PHASES, RANK, CellRecord, Finding, Level, Observation, Phase, PhaseRecord, Verdict
from harness.model.report_types import UNTOLD
from harness.standalone.failures import matching, silent
from harness.standalone.failures.matching import Around, Diagnosis, Evidence


def assess(record: CellRecord, knowledge: Knowledge = NOTHING_KNOWN, today: str = "") -> Assessed:
    """Judge a cell. `knowledge` holds the known failures, `today` is an ISO date or instant for expectations.

    Without these two, verdict, phases, lines and cases are the same. There are no causes and no silent issues then, and
    no expectation has expired.
    """
    return Assessed(record=record, knowledge=knowledge, today=today)


@dataclass(frozen=True, kw_only=True)
class Assessed:
    """A measured cell and its meaning."""

    record: CellRecord
    knowledge: Knowledge
    today: str

    # --- the verdict -------------------------------------------------------------------------------------------

    @cached_property
    def _counted(self) -> Cases:
        return counted_cases(self.record)

    @cached_property
    def _judged(self) -> Judgement:
        return judge(self.record, self._counted)

    @property
    def verdict(self) -> Verdict:
        """Return the verdict: the first row of DESIGN's table that fits."""
        return self._judged.verdict

    @property
    def phases(self) -> Outcomes:
        """Return the outcome of each phase, from the case where it ended worst."""
        return self._judged.phases

    @property
    def phase(self) -> Phase | None:
        """Return the first phase that decided the verdict."""
        return self._judged.phase

    @property
    def decisive(self) -> str | None:
        """Return the line that says why."""
        return self._judged.decisive

    @property
    def observed(self) -> Observation | None:
        """Return the cell's observation behind that line; None if the line is not ours."""
        return self._judged.observed

    @cached_property
    def unverified(self) -> tuple[str, ...]:
        """Return the phases that a working cell could not show, and silent issues neither shown nor refuted."""
        names = (name for found in self.open_issues for name in found)
        return tuple(dict.fromkeys((*self._judged.unverified, *names)))

    @property
    def fulfilled(self) -> bool:
        """Tell whether all that was asked for passed, and no silent issue is left open."""
        return expectation.is_fulfilled(self.verdict, self.phases, self.unverified)

    @property
    def untold(self) -> bool:
        """Tell whether the verdict says nothing about the packages."""
        return self.verdict in UNTOLD

    # --- its cases and its suite -------------------------------------------------------------------------------

    @cached_property
    def cases(self) -> tuple[AssessedCase, ...]:
        """Return the cases of the record, in its order, with their phases as they count."""
        # `_counted` goes on with cases of the cell that have no record.
        pairs = zip(self.record.cases, self._counted, strict=False)
        return tuple(AssessedCase(record=case, phases=phases) for case, phases in pairs)

    @cached_property
    def open_issues(self) -> tuple[tuple[str, ...], ...]:
        """Return the silent issues (`silent:ID`) of each case that fit it and that no check has shown or refuted."""
        if not self.lurking:
            return ((),) * len(self.record.cases)
        return tuple(silent.open_issues(self.lurking, case.exercised) for case in self.cases)

    @property
    def suite(self) -> PhaseRecord | None:
        """Return the phase of the subject's own suite; None where the cell has none to run."""
        return suite_phase(self.record)

    # --- known failures ----------------------------------------------------------------------------------------

    @cached_property
    def lurking(self) -> tuple[Signature, ...]:
        """Return the silent issues whose packages the cell has."""
        if self.record.installed is None:
            return ()
        return matching.lurking((self.knowledge.silent or self.knowledge.signatures)(), self._around)

    @cached_property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Return the known failures that fit a red cell: those shown by a misleading check, then the deepest cause."""
        if not known_failures.has_causes(self.verdict):
            return ()
        return known_failures.find_diagnoses(self.knowledge, self._around, self.failures, self._shown())

    def _shown(self) -> Iterator[Diagnosis]:
        if self.verdict is Verdict.MISLEADS:
            # Reversed, so that of several cases the first keeps its line.
            lines = {
                check.check: check.decisive for case in reversed(self.cases) for check in reversed(case.misleading)
            }
            yield from known_failures.shown_silent(self.lurking, [case.exercised for case in self.cases], lines)

    @property
    def suite_diagnoses(self) -> tuple[Diagnosis, ...]:
        """Return the known failures that keep the suite's environment from being made, the deepest cause first."""
        suite = self.suite
        if suite is None or not suite_not_run(suite):
            return ()
        return known_failures.find_diagnoses(
            self.knowledge, self._around, failure_texts.suite_failures(suite, self.knowledge.logs)
        )

    @cached_property
    def failures(self) -> tuple[Evidence, ...]:
        """Return the texts of each phase that failed, in every case."""
        return tuple(failure_texts.failures(self.record, self._counted[: len(self.record.cases)], self.knowledge.logs))

    @cached_property
    def _around(self) -> Around:
        """Return the packages to match known failures against: the installed ones, else those required and locked."""
        record, question = self.record, self.record.cell.question
        locked = self.knowledge.locked(record.lock) if record.lock and record.installed is None else ()
        return Around(
            installed=record.installed,
            requirements=(*question.requirements, *question.constraints, *locked),
            python=record.python or record.cell.python,
        )

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return the lines that say why the cell and its checks ended as they did."""
        return (
            self.decisive or "",
            *(line for case in self.cases for check in case.checks if (line := check.decisive)),
        )

    @property
    def failure(self) -> Failure | None:
        """Return the identity of the failure; None if the cell works, or nothing is known about its packages."""
        return identity.failure(self)

    # --- what was expected -------------------------------------------------------------------------------------

    @cached_property
    def _expected(self) -> tuple[bool | None, str | None]:
        return expectation.compare_expected(self.record.cell, self, self.today, self._names)

    def _names(self) -> tuple[str, ...]:
        """Return the ids by which an expectation may name the known failures of the cell, former ones among them."""
        signatures = [one.signature for one in known_failures.select_nameable(self)]
        return tuple(str(name) for one in signatures for name in (one.id, *one.formerly))

    @property
    def as_expected(self) -> bool | None:
        """Tell whether the cell is as expected; None where nothing can be said."""
        return self._expected[0]

    @property
    def stale(self) -> str | None:
        """Return why the expectation of the cell is out of date; None if it is not."""
        return self._expected[1]

    # --- beside it ---------------------------------------------------------------------------------------------

    @property
    def findings(self) -> dict[Finding, tuple[str, ...]]:
        """Return each finding once, with the cases in which it was seen."""
        record = self.record
        steps = [step for step in (record.resolve, record.install) if step]
        everywhere = [*record.findings, *(finding for step in steps for finding in step.findings), *self._untold()]
        seen: dict[Finding, list[str]] = {finding: [] for finding in everywhere}
        for case in record.cases:
            for finding in (finding for phase in case.phases for finding in phase.findings):
                cases = seen.setdefault(finding, [])
                cases += [] if case.case in cases else [case.case]
        seen |= {finding: [] for finding in (record.suite.findings if record.suite else ()) if finding not in seen}
        return {finding: tuple(cases) for finding, cases in seen.items()}

    def _untold(self) -> Iterator[Finding]:
        """Yield a note for each adapter whose control told nothing: a failure may as well be the adapter's."""
        for api, control in self.record.controls.items():
            if control.untold:
                text = f"whether the adapter {api} works on this machine is not known: {control.untold}"
                yield Finding(check=f"control.{api}", level=Level.NOTE, text=text)

    @property
    def attempts(self) -> int:
        """Return the largest number of attempts at a phase."""
        phases = [phase for case in self.record.cases for phase in case.phases]
        phases += [self.record.suite] if self.record.suite else []
        return max((phase.attempts for phase in phases), default=1)

    @property
    def evidence(self) -> str | None:
        """Return the log of what decided the verdict; of the last step if nothing went wrong."""
        record = self.record
        logs = [(step.phase, step.log) for step in (record.resolve, record.install) if step and step.log]
        for wanted in CASE_PHASES:
            probes = [probe for case in record.cases for probe in case.phases if probe.phase is wanted]
            probes.sort(key=lambda probe: RANK[probe.outcome])
            logs += [(probe.phase, probe.evidence) for probe in probes if probe.evidence]
        logs += [(Phase.SUITE, record.suite.evidence)] if record.suite and record.suite.evidence else []
        return next((log for at, log in logs if at is self.phase), logs[-1][1] if logs else None)

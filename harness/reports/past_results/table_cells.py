"""Make measured cells of rows of a table, which has the first failing phase of each case and nothing else.

Phases before the first failing one passed. Those after it were not reached, or nobody wrote down how they ended.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from harness.judging.known_failures import select_counting
from harness.matrix.signatures import Signature
from harness.model import Outcome, Phase, Verdict
from harness.model.measured import MeasuredCell
from harness.model.report_types import CaseEntry
from harness.model.vocabulary import FAMILY, parsed_requirement, required_name
from harness.standalone.failures import matching, silent
from harness.standalone.failures.matching import Around, Diagnosis, Evidence

STEPS = (Phase.RESOLVE, Phase.INSTALL)
PROBED = (Phase.IMPORT, Phase.SINGLE, Phase.VECTOR, Phase.RENDER)
WORST = (Outcome.FAILED, Outcome.NOT_REACHED, Outcome.PASSED)


@dataclass(frozen=True, kw_only=True)
class Table:
    """The facts that are the same for all rows: the name of their matrix, their file, day and machine."""

    matrix: str
    source: str
    measured: str
    machine: str
    supplied: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class RowCase:
    """One case of a row; `first_failure` is None if nothing failed."""

    env: str | None
    api: str
    first_failure: Phase | None
    decisive: str | None = None
    more: tuple[str, ...] = ()

    @property
    def phases(self) -> dict[Phase, Outcome]:
        """Return how the phases ended, as far as that is known."""
        failure = self.first_failure
        if failure in STEPS:
            return dict.fromkeys(PROBED, Outcome.NOT_REACHED)
        place = PROBED.index(failure) if failure else len(PROBED)
        phases = dict.fromkeys(PROBED[:place], Outcome.PASSED)
        if self.api not in FAMILY:
            # Other APIs have no environments in batches, and the table does not say what was tried instead.
            phases.pop(Phase.VECTOR, None)
        if failure:
            phases[failure] = Outcome.FAILED
        if failure in {Phase.IMPORT, Phase.SINGLE}:
            phases |= dict.fromkeys(PROBED[place + 1 :], Outcome.NOT_REACHED)
        return phases


@dataclass(frozen=True, kw_only=True)
class Row:
    """One combination. `causes` are known issues that the table names; None where it names none."""

    label: str
    python: str
    requirements: tuple[str, ...]
    cases: tuple[RowCase, ...]
    installed: Mapping[str, str]
    environment: Mapping[str, str]
    causes: tuple[str, ...] | None = None

    @cached_property
    def verdict(self) -> Verdict:
        """Return the verdict on the cases together."""
        failures = {case.first_failure for case in self.cases}
        if Phase.RESOLVE in failures:
            return Verdict.UNRESOLVABLE
        if Phase.INSTALL in failures:
            return Verdict.UNINSTALLABLE
        if failures == {Phase.IMPORT}:
            return Verdict.IMPORT_FAILS
        if failures == {None}:
            return Verdict.WORKS
        some = any(case.phases.get(Phase.SINGLE) is Outcome.PASSED for case in self.cases)
        return Verdict.PARTIAL if some else Verdict.BROKEN

    @cached_property
    def phases(self) -> dict[Phase, Outcome]:
        """Return the worst outcome of each phase, as far as that is known."""
        steps = {Phase.RESOLVE: Outcome.PASSED, Phase.INSTALL: Outcome.PASSED}
        if self.verdict is Verdict.UNRESOLVABLE:
            steps = {Phase.RESOLVE: Outcome.FAILED, Phase.INSTALL: Outcome.NOT_REACHED}
        elif self.verdict is Verdict.UNINSTALLABLE:
            steps[Phase.INSTALL] = Outcome.FAILED
        probed: dict[Phase, Outcome] = {}
        for phase in PROBED:
            ended = {case.phases[phase] for case in self.cases if phase in case.phases}
            worst = next((outcome for outcome in WORST if outcome in ended), None)
            # A phase that some case leaves open is known only where another case failed in it.
            if worst and (worst is not Outcome.PASSED or all(phase in case.phases for case in self.cases)):
                probed[phase] = worst
        return steps | probed

    @cached_property
    def versions(self) -> dict[str, str] | None:
        """Return the installed versions that are known: those of the table, and the pinned ones."""
        if self.verdict in {Verdict.UNRESOLVABLE, Verdict.UNINSTALLABLE}:
            return None
        pinned = {
            required_name(text): part.version
            for text in self.requirements
            for part in parsed_requirement(text).specifier
            if part.operator == "==" and not part.version.endswith("*")
        }
        return pinned | dict(self.installed)

    @property
    def around(self) -> Around:
        """Return the context of its failures."""
        return Around(installed=self.versions, requirements=self.requirements, python=self.python)


@dataclass(frozen=True)
class Explained:
    """A row with the known failures that fit it."""

    diagnoses: tuple[Diagnosis, ...]
    reasons: tuple[str, ...]


def make_cell(row: Row, table: Table, signatures: Iterable[Signature]) -> MeasuredCell:
    """Return a row as a measured cell. `signatures` say which known issues fit it, silent ones among them."""
    issues = tuple(signatures)
    lurking = matching.lurking(issues, row.around) if row.versions else ()
    cases = tuple(_case(case, lurking) for case in row.cases)
    failed = next((phase for phase, outcome in row.phases.items() if outcome is Outcome.FAILED), None)
    return MeasuredCell(
        id=f"{table.matrix}/{row.label}",
        matrix=table.matrix,
        axes={"python": row.python},
        requested_python=row.python,
        python=row.python,
        machine=table.machine,
        environment=dict(row.environment),
        supplied={name: value for name, value in table.supplied.items() if name not in row.environment},
        installed=row.versions,
        lock=None,
        lock_sha256=None,
        key=None,
        measured=table.measured,
        reused=False,
        inferred=False,
        attempts=1,
        seconds=0.0,
        verdict=row.verdict,
        unverified=tuple(dict.fromkeys(name for case in cases for name in case.unverified)),
        expected=row.verdict,
        as_expected=None,
        repairs=(),
        findings=(),
        phases=row.phases,
        cases=cases,
        decisive=next((case.decisive for case in row.cases if case.decisive and case.first_failure is failed), None),
        diagnoses=(),
        evidence=None,
        phase=failed,
        requirements=row.requirements,
        causes=_causes(row, issues) if row.causes is None else row.causes,
        source=table.source,
        first_failure_only=row.verdict is not Verdict.WORKS,
    )


def _case(case: RowCase, lurking: Iterable[Signature]) -> CaseEntry:
    # By what its pictures were drawn is not known: an issue of OpenGL is not excluded.
    ended = {str(phase): str(outcome) for phase, outcome in case.phases.items()}
    result = silent.CaseResult(env=case.env, api=case.api, phases=ended, checks={}, opengl=True)
    return CaseEntry(
        case=case.env or "import",
        env=case.env,
        api=case.api,
        phases=case.phases,
        checks={},
        frames=(),
        decisive=case.decisive,
        unverified=silent.open_issues(lurking, result),
    )


def _causes(row: Row, signatures: Iterable[Signature]) -> tuple[str, ...]:
    """Return the ids of the known failures that the lines of a row show."""
    evidence = tuple(_evidence(row.cases))
    diagnoses = matching.diagnose(signatures, evidence, row.around)
    explained = Explained(diagnoses=diagnoses, reasons=tuple(line for one in evidence for line in one.reasons))
    return tuple(one.signature.id for one in select_counting(explained))


def _evidence(cases: Iterable[RowCase]) -> Iterator[Evidence]:
    for case in cases:
        lines = tuple(filter(None, (case.decisive, *case.more)))
        if case.first_failure and lines:
            yield Evidence(phase=case.first_failure, reasons=lines)

"""Judge one case of a cell as it counts: findings that it forbids fail it, and controls discount its failures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from harness.judging.counted_phases import counts, reason
from harness.judging.runs import misleading
from harness.model import CaseRecord, CheckRecord, Outcome, PhaseRecord, worst
from harness.standalone.failures import silent

DRAWN = ("api", "vendor", "renderer", "version", "device")
LONGEST_TEXT = 300


@dataclass(frozen=True, kw_only=True)
class AssessedCase:
    """A measured case, and its `phases` as they count: all that a case can have, in order."""

    record: CaseRecord
    phases: tuple[PhaseRecord, ...]

    @cached_property
    def checks(self) -> tuple[CheckRecord, ...]:
        """Return the checks of all phases."""
        return tuple(check for phase in self.phases for check in phase.checks)

    @property
    def reported_phases(self) -> tuple[PhaseRecord, ...]:
        """Return the phases to report: all, except the last one if nothing of it was asked for."""
        return tuple(phase for phase in self.phases if counts(phase))

    @property
    def misleading(self) -> tuple[CheckRecord, ...]:
        """Return the checks by which the case contradicts its own specification."""
        return misleading.find(self.checks)

    @property
    def misleads(self) -> tuple[str, ...]:
        """Return the names of the misleading checks."""
        return tuple(check.check for check in self.misleading)

    @property
    def decisive(self) -> str | None:
        """Return the reason of the first phase that ended worst; None if nothing went wrong."""
        fine = {Outcome.PASSED, Outcome.SKIPPED, Outcome.NOT_REACHED}
        bad_phases = [phase for phase in self.phases if phase.outcome not in fine]
        poorest = worst(phase.outcome for phase in bad_phases)
        return next((reason(phase) for phase in bad_phases if phase.outcome is poorest), None)

    @property
    def drawn(self) -> Mapping[str, str]:
        """Return the OpenGL context of its pictures, as the first check that drew noted it."""
        return next((context for check in self.checks if (context := _drawn_by(check))), {})

    @property
    def packages(self) -> tuple[str, ...]:
        """Return the packages whose code its checks ran, as the cell noted them."""
        return tuple(sorted({str(name) for check in self.checks for name in check.facts.get("exercised", ())}))

    @property
    def exercised(self) -> silent.CaseResult:
        """Return the case in the form that silent issues are compared with."""
        return silent.CaseResult(
            env=self.record.env,
            api=self.record.api,
            phases={phase.phase: phase.outcome for phase in self.phases},
            checks={check.check: check.outcome for check in self.checks},
            opengl=bool(self.drawn),
        )


def _drawn_by(check: CheckRecord) -> dict[str, str]:
    """Return the OpenGL context that a check noted for its picture; a cell may have written anything there."""
    context = check.facts.get("gl")
    return (
        {name: str(context[name])[:LONGEST_TEXT] for name in DRAWN if name in context}
        if isinstance(context, dict)
        else {}
    )

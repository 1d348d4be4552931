"""One case of a cell as it counts: with the findings that it requires not to be there, and discounted by controls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from harness.judging.counted_phases import counts, reason
from harness.judging.runs import misleading
from harness.model import CaseRecord, CheckRecord, Outcome, PhaseRecord, worst
from harness.standalone import silent

DRAWN = ("api", "vendor", "renderer", "version", "device")
LONGEST_TEXT = 300


@dataclass(frozen=True, kw_only=True)
class AssessedCase:
    """A case as it was measured, and `phases` as they count: all that a case can have, in order."""

    record: CaseRecord
    phases: tuple[PhaseRecord, ...]

    @cached_property
    def checks(self) -> tuple[CheckRecord, ...]:
        """The checks of all phases."""
        return tuple(check for phase in self.phases for check in phase.checks)

    @property
    def told(self) -> tuple[PhaseRecord, ...]:
        """The phases that are told of: all but one of which nothing was asked."""
        return tuple(phase for phase in self.phases if counts(phase))

    @property
    def misleading(self) -> tuple[CheckRecord, ...]:
        """The checks by which the case contradicts its own specification."""
        return misleading.shown(self.checks)

    @property
    def misleads(self) -> tuple[str, ...]:
        """The names of these checks."""
        return tuple(check.check for check in self.misleading)

    @property
    def decisive(self) -> str | None:
        """The reason of the first phase that ended worst; None where nothing went wrong."""
        fine = {Outcome.PASSED, Outcome.SKIPPED, Outcome.NOT_REACHED}
        told = [phase for phase in self.phases if phase.outcome not in fine]
        poorest = worst(phase.outcome for phase in told)
        return next((reason(phase) for phase in told if phase.outcome is poorest), None)

    @property
    def drawn(self) -> Mapping[str, str]:
        """Return the OpenGL context of its pictures, as the first check that drew noted it."""
        return next((said for check in self.checks if (said := _drawn_by(check))), {})

    @property
    def packages(self) -> tuple[str, ...]:
        """The packages whose code its checks ran, as the cell noted them."""
        return tuple(sorted({str(name) for check in self.checks for name in check.facts.get("exercised", ())}))

    @property
    def exercised(self) -> silent.Exercised:
        """The case as silent issues see it."""
        return silent.Exercised(
            env=self.record.env,
            api=self.record.api,
            phases={phase.phase: phase.outcome for phase in self.phases},
            checks={check.check: check.outcome for check in self.checks},
            opengl=bool(self.drawn),
        )


def _drawn_by(check: CheckRecord) -> dict[str, str]:
    """Return what a check says of the OpenGL context that drew for it; a cell may have written anything there."""
    told = check.facts.get("gl")
    return {name: str(told[name])[:LONGEST_TEXT] for name in DRAWN if name in told} if isinstance(told, dict) else {}

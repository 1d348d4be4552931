"""Raise the failed step of a build or an install, past all that wait for what was to be made."""

from __future__ import annotations

from harness.model import Outcome, Phase, Step


class StepFailed(Exception):
    """A wheel or an environment could not be made: `step` says why."""

    def __init__(self, step: Step) -> None:
        super().__init__(step.decisive)
        self.step = step


def install_failed(outcome: Outcome, decisive: str, log: str | None = None) -> StepFailed:
    """Return the error of an install that ended so."""
    return StepFailed(Step(phase=Phase.INSTALL, outcome=outcome, decisive=decisive, log=log))

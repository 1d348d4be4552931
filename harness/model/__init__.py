"""Speak the words that every room shares: cells, plans, locks, records; frozen values and enums, without I/O."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.model.values import (
        CASE_PHASES,
        CELL_PHASES,
        FAILING,
        RANK,
        Artifact,
        Bring,
        Brought,
        Case,
        CaseRecord,
        Cell,
        CellRecord,
        Change,
        CheckRecord,
        CheckReply,
        ControlRecord,
        Dropped,
        Edit,
        Expectation,
        Finding,
        IndexSettings,
        Interpreter,
        Level,
        Lock,
        Observed,
        Outcome,
        Phase,
        PhaseRecord,
        Pin,
        Plan,
        ProbeReply,
        ProbeRequest,
        Question,
        Raised,
        Repair,
        Role,
        Step,
        Subject,
        Suite,
        Tested,
        Tried,
        Verdict,
        WorkerRecord,
        worst,
    )

__all__ = [
    "CASE_PHASES",
    "CELL_PHASES",
    "FAILING",
    "RANK",
    "Artifact",
    "Bring",
    "Brought",
    "Case",
    "CaseRecord",
    "Cell",
    "CellRecord",
    "Change",
    "CheckRecord",
    "CheckReply",
    "ControlRecord",
    "Dropped",
    "Edit",
    "Expectation",
    "Finding",
    "IndexSettings",
    "Interpreter",
    "Level",
    "Lock",
    "Observed",
    "Outcome",
    "Phase",
    "PhaseRecord",
    "Pin",
    "Plan",
    "ProbeReply",
    "ProbeRequest",
    "Question",
    "Raised",
    "Repair",
    "Role",
    "Step",
    "Subject",
    "Suite",
    "Tested",
    "Tried",
    "Verdict",
    "WorkerRecord",
    "worst",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Return a value of the room at its first use: errors, which every start needs, do without them."""
        if name not in __all__:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        from harness.model import values  # noqa: PLC0415 - start-up

        return globals().setdefault(name, getattr(values, name))

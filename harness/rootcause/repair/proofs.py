"""Turn the result of a repair into a document: the failure, the remedy in lines to paste, and every run."""

from __future__ import annotations

from typing import Any

import msgspec

from harness.machine import this_machine
from harness.machine.store import now
from harness.matrix import changes
from harness.model import Change, Phase, Verdict
from harness.rootcause.bench import Trial
from harness.rootcause.repair import pasting, stages
from harness.rootcause.repair.lab import Lab, Run, describe_result
from harness.rootcause.repair.repairing import Part, RepairResult, Status
from harness.rootcause.search_documents import trial_fields


class CauseEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A known failure that fits the evidence."""

    signature: str
    cause: str
    masks: bool
    references: tuple[str, ...] = ()


class RunEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One cell of the search: the change, the reason to try it, and its result up to a phase.

    `at_hand` is true if it had been measured before, `key` belongs to its environment. If it was `guarded`, big
    packages were not built from source, which is no part of the change.
    """

    number: int
    why: str
    does: tuple[str, ...]
    change: dict[str, Any]
    guarded: bool
    until: Phase
    ended: str
    verdict: Verdict
    phase: Phase | None
    decisive: str | None
    causes: tuple[str, ...]
    unverified: tuple[str, ...]
    lock_sha256: str | None
    key: str | None
    python: str | None
    seconds: float
    at_hand: bool


class PartEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A part of the remedy. It is `necessary` if the cell fails without it, in the run `without`."""

    does: tuple[str, ...]
    change: dict[str, Any]
    necessary: bool | None
    without: int | None


class RemedyEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The change that cures. The user had bounded the `moved` packages otherwise; no cure was found that keeps them.

    `sufficient` is true if the cell with the whole remedy was measured here, in every phase, and works: in the run
    `proof`, which has its lock.
    """

    way: str
    why: str
    does: tuple[str, ...]
    change: dict[str, Any]
    moved: tuple[str, ...]
    parts: tuple[PartEntry, ...]
    necessary: bool
    sufficient: bool
    proof: int
    cell: str
    unverified: tuple[str, ...]
    paste: pasting.PasteEntry


class RepairDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The document of `repair`: `repair.json`, and its `--json` output.

    `measured` counts the runs that were not at hand, `built` the environments that had to be built, `bound` the tests
    that binary searches for single culprits need at most, if there was anything to search.
    """

    schema: int = 1
    generated: str
    cell: str
    status: Status
    decisive: str | None
    causes: tuple[CauseEntry, ...]
    remedy: RemedyEntry | None
    runs: tuple[RunEntry, ...]
    measured: int
    built: int
    bound: int
    seconds: float
    stopped: str | None
    left: tuple[str, ...]
    told: tuple[str, ...]
    machine: str
    facts: dict[str, Any]
    command: str
    lock: str | None = None
    files: tuple[str, ...] = ()


def document(lab: Lab, repaired: RepairResult, command: str) -> RepairDocument:
    """Return the document of a repair."""
    here = this_machine.facts()
    before = repaired.before
    return RepairDocument(
        generated=now(),
        cell=lab.base.id,
        status=repaired.status,
        decisive=before.assessed.decisive,
        causes=tuple(
            CauseEntry(
                signature=one.signature.id,
                cause=one.signature.cause,
                masks=one.signature.masks,
                references=one.signature.references,
            )
            for one in before.assessed.diagnoses
        ),
        remedy=_remedy(lab, repaired) if repaired.change and repaired.proof else None,
        runs=tuple(_run(number, one) for number, one in enumerate(lab.runs, start=1)),
        measured=lab.bench.runs,
        built=len(lab.bench.built),
        bound=repaired.bound,
        seconds=round(lab.bench.seconds, 1),
        stopped=repaired.stopped,
        left=repaired.left,
        told=repaired.notes,
        machine=here.id,
        facts=dict(here.facts),
        command=command,
    )


def _run(number: int, run: Run) -> RunEntry:
    # The guard is HEAVY minus what the cell requires; its size tells it apart from a remedy that names a few.
    guarded = len({*run.change.only_binary} & {*stages.HEAVY}) > len(stages.HEAVY) // 2
    plain = stages.remove_guard(run.change) if guarded else run.change
    return RunEntry(
        number=number,
        why=run.why,
        does=changes.describe(plain),
        change=plain.plain,
        guarded=guarded,
        until=run.until,
        ended=describe_result(run.trial, run.until),
        unverified=run.trial.assessed.unverified,
        **trial_fields(run.trial),
    )


def _remedy(lab: Lab, repaired: RepairResult) -> RemedyEntry:
    change, proof = repaired.change or Change(), repaired.proof or repaired.before
    return RemedyEntry(
        way=str(repaired.way),
        why=repaired.why,
        does=changes.describe(change),
        change=change.plain,
        moved=repaired.moved,
        parts=tuple(_part(lab, one) for one in repaired.parts),
        necessary=all(one.without is not None for one in repaired.parts),
        sufficient=proof.works and lab.shown(proof) is not None,
        proof=_number(lab, lab.shown(proof) or proof),
        cell=proof.cell.id,
        unverified=proof.assessed.unverified,
        paste=pasting.paste(proof.cell, change),
    )


def _part(lab: Lab, part: Part) -> PartEntry:
    return PartEntry(
        does=changes.describe(part.change),
        change=part.change.plain,
        necessary=True if part.without else None,
        without=_number(lab, part.without) if part.without else None,
    )


def _number(lab: Lab, trial: Trial) -> int:
    return next(number for number, one in enumerate(lab.runs, start=1) if one.trial is trial)

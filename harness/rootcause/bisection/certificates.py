"""Turn the result of a bisection into a document: the claim, all runs, both neighbours, and how to repeat it."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from datetime import date, timedelta
from typing import Any

import msgspec

from harness.machine import this_machine
from harness.machine.store import now
from harness.model import Cell, Phase, Verdict
from harness.model.report_types import format_count
from harness.rootcause import search, search_documents
from harness.rootcause.bench import Trial
from harness.rootcause.bisection.behaviour import BehaviourPredicate
from harness.rootcause.bisection.bisecting import LOOKING, Bisection, BisectionResult, Status, Step
from harness.rootcause.bisection.candidates import Candidate, diff_locks
from harness.rootcause.bisection.predicate import strip_run_count
from harness.rootcause.search import Answer, Turn
from harness.rootcause.search_documents import trial_fields

DATE = "--date"


class PredicateEntry(msgspec.Struct, frozen=True, kw_only=True):
    """The definition of bad. `same` is true if only this failure counts, false if any does.

    `behaves` says in words which behaviour is bad; then no failure is.
    """

    same: bool
    phase: Phase | None
    causes: tuple[str, ...]
    line: str | None
    behaves: str | None = None


class StepEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One run: the candidate, the reason to test it, and its result.

    `answer` is the answer of the predicate, `at_hand` is true if nothing was run for it, `key` belongs to its
    environment.
    """

    number: int
    candidate: str
    why: str
    answer: Answer
    words: str
    verdict: Verdict
    phase: Phase | None
    decisive: str | None
    causes: tuple[str, ...]
    python: str | None
    lock_sha256: str | None
    key: str | None
    seconds: float
    at_hand: bool


class NeighbourEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One side of the boundary. `run` is the number of its run in all phases, `lock` a file beside the document."""

    candidate: str
    run: int
    cell: str
    verdict: Verdict
    decisive: str | None
    lock_sha256: str | None
    lock: str | None = None


class TurnEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A change along the line: the results before and after it. `untested` counts the candidates between."""

    before: str
    after: str
    was: str
    becomes: str
    untested: int


class MovedEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A package that the locks of the neighbours hold in different versions; null where one has none."""

    name: str
    good: str | None
    bad: str | None


class BisectDocument(msgspec.Struct, frozen=True, kw_only=True):
    """The certificate of `bisect`: `bisect.json`, and its `--json` output.

    `candidates` counts the candidates from end to end, both ends included; `bound` is the most tests that a binary
    search needs for so many. `asked` counts the answers taken, `for_an_end` those used to find a good end, `measured`
    the runs that were not at hand, `built` the environments that had to be built. `confidence` is the chance that the
    boundary is right, given all answers and the flakiness seen (`flakiness`: how often a bad candidate looks good, and
    a good one bad).
    """

    schema: int = 1
    generated: str
    cell: str
    axis: str
    status: Status
    claim: str
    predicate: PredicateEntry | None
    good: NeighbourEntry | None
    bad: NeighbourEntry | None
    between: tuple[str, ...]
    chain: tuple[TurnEntry, ...]
    moved: tuple[MovedEntry, ...]
    confidence: float | None
    flakiness: tuple[float, float] | None
    ends: tuple[str, str]
    candidates: int
    bound: int
    asked: int
    for_an_end: int
    measured: int
    built: int
    runs: tuple[StepEntry, ...]
    left_out: tuple[str, ...]
    told: tuple[str, ...]
    seconds: float
    machine: str
    facts: dict[str, Any]
    command: str
    files: tuple[str, ...] = ()


def document(done: BisectionResult, search_: Bisection, *, left_out: tuple[str, ...], command: str) -> BisectDocument:
    """Return the document of a bisection."""
    here, boundary, task, bench = this_machine.facts(), done.boundary, search_.task, search_.bench
    has_neighbours = done.good is not None and done.bad is not None
    return BisectDocument(
        generated=now(),
        cell=task.cell.id,
        axis=task.axis,
        status=done.status,
        claim=claim(done, task.cell, task.axis),
        predicate=_predicate(done),
        good=_neighbour(done.good, search_),
        bad=_neighbour(done.bad, search_),
        between=tuple(one.name for one in boundary.between) if boundary and has_neighbours else (),
        chain=tuple(_turn(turn, done) for turn in boundary.chain) if boundary else (),
        moved=_moved(done.good.trial, done.bad.trial) if done.good and done.bad else (),
        confidence=round(boundary.confidence, 6) if boundary and has_neighbours else None,
        flakiness=(round(boundary.rates[0], 4), round(boundary.rates[1], 4)) if boundary else None,
        ends=(done.line[0].name, done.line[-1].name),
        candidates=len(done.line),
        bound=search.bound(len(done.line)),
        asked=sum(step.why != "whole" and not step.trial.at_hand for step in search_.steps),
        # The good end that was found is subtracted, because `bound` counts both ends.
        for_an_end=max(0, sum(step.why == LOOKING and not step.trial.at_hand for step in search_.steps) - 1),
        measured=bench.runs,
        built=len(bench.built),
        runs=tuple(_step(number, step) for number, step in enumerate(search_.steps, start=1)),
        left_out=left_out,
        told=done.notes,
        seconds=round(bench.seconds, 1),
        machine=here.id,
        facts=dict(here.facts),
        command=command,
    )


def _predicate(done: BisectionResult) -> PredicateEntry | None:
    if done.predicate is None:
        return None
    if isinstance(done.predicate, BehaviourPredicate):
        return PredicateEntry(same=False, phase=Phase.BEHAVE, causes=(), line=None, behaves=done.predicate.words)
    failed = done.predicate.failure
    if failed is None:
        return PredicateEntry(same=False, phase=None, causes=(), line=None)
    return PredicateEntry(same=True, phase=failed.phase, causes=failed.causes, line=failed.line)


def _step(number: int, step: Step) -> StepEntry:
    return StepEntry(
        number=number,
        candidate=step.candidate.name,
        why=step.why,
        answer=step.classification.answer,
        words=step.classification.words,
        **trial_fields(step.trial),
    )


def _neighbour(step: Step | None, done: Bisection) -> NeighbourEntry | None:
    if step is None:
        return None
    return NeighbourEntry(
        candidate=step.candidate.name,
        run=1 + next(number for number, one in enumerate(done.steps) if one is step),
        cell=step.trial.cell.id,
        verdict=step.trial.assessed.verdict,
        decisive=step.trial.assessed.decisive,
        lock_sha256=step.trial.record.lock_sha256,
    )


def _turn(turn: Turn[Candidate], done: BisectionResult) -> TurnEntry:
    words: dict[Hashable, str] = {Answer.GOOD: "works", Answer.BAD: "fails"}
    if isinstance(done.predicate, BehaviourPredicate):
        words = {Answer.GOOD: "behaves the same", Answer.BAD: "behaves otherwise"}
    elif done.predicate and (failed := done.predicate.failure):
        words[Answer.BAD] = f"{failed.phase}: {failed.causes[0] if failed.causes else failed.line}"
    return TurnEntry(
        before=turn.before.name,
        after=turn.after.name,
        was=words.get(turn.was, str(turn.was)),
        becomes=words.get(turn.becomes, str(turn.becomes)),
        untested=len(turn.between),
    )


def _moved(good: Trial, bad: Trial) -> tuple[MovedEntry, ...]:
    """Return the packages that differ between the locks; none if either neighbour has no lock."""
    old, new = good.versions, bad.versions
    differences = diff_locks(old, new) if old and new else ()
    return tuple(MovedEntry(name=name, good=version, bad=other) for name, version, other in differences)


# --- in words --------------------------------------------------------------------------------------------------


def claim(done: BisectionResult, cell: Cell, axis: str) -> str:
    """Return the result of a bisection in one sentence."""
    good, bad = done.good, done.bad
    if done.status is not Status.FOUND or good is None or bad is None:
        reasons = "; ".join(done.notes) or "no candidate was found that works"
        return f"{cell.id}: {done.status} along {axis}: {reasons}"
    thing = {DATE: "the index of", "--python": "Python"}.get(axis, axis)
    names = [f"{thing} {_last(done, one, axis)}" for one in (good, bad)]
    last, first = ("last", "first") if done.oldest_first else ("first", "last")
    works, what = _sides(done, good, bad)
    comma = "," if "," in works else ""
    return f"{names[0]} is the {last} that {works}{comma} and {names[1]} the {first} that {what}{_gap(done)}"


def _sides(done: BisectionResult, good: Step, bad: Step) -> tuple[str, str]:
    """Return what the good and the bad neighbour do."""
    if isinstance(done.predicate, BehaviourPredicate):
        return good.classification.words, bad.classification.words
    works = good.trial.success_text if good.trial.works else f"is without this failure ({good.classification.words})"
    failing = strip_run_count(bad.trial.failure) or (done.predicate.failure if done.predicate else None)
    return works, f"fails with {failing.line}" if failing and failing.line else "fails"


def _last(done: BisectionResult, neighbour: Step, axis: str) -> str:
    """Return the name of a neighbour. The older one of two days lasts until the day before the next upload."""
    line = [each.name for each in done.line]
    place, newer = line.index(neighbour.candidate.name), 1 if done.oldest_first else -1
    older = neighbour is (done.good if done.oldest_first else done.bad)
    if axis != DATE or not older or not 0 <= place + newer < len(line):
        return neighbour.candidate.name
    eve = date.fromisoformat(line[place + newer][:10]) - timedelta(days=1)
    return max(neighbour.candidate.name[:10], eve.isoformat())


def _gap(done: BisectionResult) -> str:
    """Return a phrase on the candidates between the neighbours; empty if there are none."""
    boundary = done.boundary
    if boundary is None or not boundary.between:
        return ""
    others = [turn for turn in boundary.chain if turn.becomes not in set(Answer)]
    count = format_count(len(boundary.between), "candidate")
    if others:
        return f"; between them {count} of other failures, the first of {others[0].after.name}: {others[0].becomes}"
    return f"; between them {count} that could not be tested or were not tried"


def page(certificate: BisectDocument) -> str:
    """Return the certificate as a page, from the template `templates/bisect.md.j2`."""
    return search_documents.page("bisect.md.j2", certificate)


def lines(certificate: BisectDocument) -> Iterator[str]:
    """Yield the certificate as lines for a terminal."""
    yield certificate.claim
    if certificate.predicate:
        bad = certificate.predicate
        failing = f"the same failure in {bad.phase}" if bad.same else bad.behaves or "any failure"
        yield f"bad is: {failing}{f' ({bad.causes[0]})' if bad.causes else ''}"
    if len(certificate.chain) > 1:
        yield "the chain:"
        for turn in certificate.chain:
            untested = f" ({turn.untested} between not tested)" if turn.untested else ""
            yield f"  {turn.before} -> {turn.after}: {turn.was}, then {turn.becomes}{untested}"
    moved = [f"{one.name} {one.good or 'absent'} -> {one.bad or 'absent'}" for one in certificate.moved]
    if moved:
        yield f"between their locks: {', '.join(moved[:8])}{f' and {len(moved) - 8} more' if len(moved) > 8 else ''}"
    if certificate.good:
        yield from (f"note: {one}" for one in certificate.told)
    if certificate.confidence is not None:
        yield f"confidence: {certificate.confidence:.4f}"
    good_end_text = f" ({certificate.for_an_end} of them for a good end)" if certificate.for_an_end else ""
    built = format_count(certificate.built, "environment")
    bound = f"a binary search asks {certificate.bound} of {certificate.candidates} at most"
    yield f"{certificate.asked} asked{good_end_text}, {built} built; {bound}"
    yield from (f"left out: {one}" for one in certificate.left_out)
    yield f"repeat it: {certificate.command}"
    yield from (f"written: {name}" for name in certificate.files)

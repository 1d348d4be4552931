"""Write the result of a repair in words: for a terminal, and as a page."""

from __future__ import annotations

from collections.abc import Iterator

from harness.model.report_types import format_count
from harness.rootcause import search_documents
from harness.rootcause.repair import pasting
from harness.rootcause.repair.candidate_changes import Way
from harness.rootcause.repair.proofs import RemedyEntry, RepairDocument, RunEntry
from harness.rootcause.repair.repairing import Status
from harness.standalone.failures.silent import silent_ids


def lines(document: RepairDocument) -> Iterator[str]:
    """Yield the document as lines for a terminal."""
    before = document.runs[0]
    doubts = silent_ids(before.unverified)
    if document.status is Status.GREEN and doubts:
        yield f"{document.cell} works, but a silent known issue is not excluded: {', '.join(doubts)}"
        yield f"next: simmatrix known {doubts[0]}"
        return
    if document.status is Status.GREEN:
        yield f"{document.cell} {_ended(before)}: there is nothing to repair"
        return
    yield f"{document.cell}: {_ended(before)}"
    if before.decisive:
        yield f"  {before.decisive}"
    if document.status is Status.UNTOLD and len(document.runs) == 1:
        yield "the packages were not tested, so there is nothing to repair; fix that and run the same command again"
        return
    for cause in document.causes[:1]:
        yield f"{'hides why' if cause.masks else 'cause'}: {cause.cause} [{cause.signature}]"
    yield ""
    yield from _describe_remedy(document, document.remedy) if document.remedy else _nothing(document)
    yield from (f"note: {one}" for one in document.told)
    spent = f"{format_count(document.measured, 'run')}, {format_count(document.built, 'environment')} built"
    bounded = f" (binary searches need {document.bound} tests at most)" if document.bound else ""
    yield f"{spent}{bounded}, {document.seconds:.0f} s"
    yield from (f"written: {name}" for name in document.files)


def _describe_remedy(document: RepairDocument, remedy: RemedyEntry) -> Iterator[str]:
    if remedy.moved and remedy.way == Way.REFUSED:
        yield f"you asked for another {' and '.join(remedy.moved)}: {remedy.why}"
    elif remedy.moved:
        yield (
            f"no other change that was tried fixes it: {' and '.join(remedy.moved)} must change, although you "
            "limited it"
        )
    yield f"remedy: {'; '.join(remedy.does)}"
    yield from pasting.lines(remedy.paste)
    for part in remedy.parts:
        does = "; ".join(part.does)
        if part.without is None:
            yield f"necessary: not shown for {does}"
        else:
            ended = _ended(document.runs[part.without - 1])
            yield f"necessary: it fails without the step: {does} (run {part.without}: {ended})"
    proof = document.runs[remedy.proof - 1]
    if remedy.sufficient:
        open_ends = f", not verified: {', '.join(remedy.unverified)}" if remedy.unverified else ""
        yield f"sufficient: with it every check passes (run {remedy.proof}, {proof.seconds:.0f} s{open_ends})"
    if document.stopped:
        yield f"stopped early: {document.stopped}; a smaller change may be enough"


def _nothing(document: RepairDocument) -> Iterator[str]:
    if document.status is Status.UNTOLD:
        yield "no change that could be measured fixes it; solve the problem in the note and run the same command again"
    elif document.status is Status.STOPPED:
        yield f"stopped early: {document.stopped}; not tried yet: {', '.join(document.left)}"
    else:
        tried = max(len(document.runs) - 1, 0)
        yield f"no change fixes it; {tried} {'was' if tried == 1 else 'were'} tried"


def _ended(run: RunEntry) -> str:
    return run.ended.replace("_", " ")


def page(document: RepairDocument) -> str:
    """Return the document as a page, from the template `templates/repair.md.j2`."""
    lines = pasting.lines(document.remedy.paste) if document.remedy else ()
    return search_documents.page("repair.md.j2", document, refused=Way.REFUSED, lines=[line.strip() for line in lines])

"""Write the answer of `check` for people: the sum in one line, then findings by kind, the worst first."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from harness.model.report_types import first_few, format_count
from harness.reports.projects.check_document import FAULTS, Checked, CheckFinding, Kind
from harness.reports.projects.labelled_lines import labelled

NAMED = 6
LONGEST = 240
LABELS = {
    Kind.GOOD: "good",
    Kind.BAD: "bad",
    Kind.ADMITS: "admits bad",
    Kind.CHANGES: "changes",
    Kind.CONFLICT: "conflict",
    Kind.UNMEASURED: "unknown",
    Kind.EXCLUDES: "note",
}
PURPOSES = {Kind.CHANGES: "within which nothing changes"}
WIDTH = max(map(len, LABELS.values())) + 2


def lines(document: Checked, most: int | None = None) -> Iterator[str]:
    """Yield the lines; at most so many findings of a kind."""
    yield f"{document.source}: {_sum(document)}"
    for kind in Kind:
        findings = [finding for finding in document.findings if finding.kind is kind]
        for finding in findings[:most]:
            yield from _finding(finding)
        if most is not None and len(findings) > most:
            yield _labelled("", f"and {len(findings) - most} more: --all")
    if document.not_run:
        count = format_count(len(document.not_run), "package")
        yield _labelled("not run", f"{count} that no measurement ran: {first_few(document.not_run, NAMED)}")
    for text in document.unjudged[:most]:
        yield _labelled("not judged", text)
    if most is not None and len(document.unjudged) > most:
        yield _labelled("", f"and {len(document.unjudged) - most} more: --all")


def _sum(document: Checked) -> str:
    kinds = [finding.kind for finding in document.findings]
    faults = sum(kind in FAULTS for kind in kinds)
    if faults:
        return format_count(faults, "finding")
    if Kind.GOOD not in kinds:
        return "nothing of it was measured"
    return "measured good in part; the rest was never measured" if Kind.UNMEASURED in kinds else "measured good"


def _finding(finding: CheckFinding) -> Iterator[str]:
    yield _labelled(LABELS[finding.kind], finding.text)
    if finding.line and finding.kind is not Kind.GOOD:
        yield _labelled("", textwrap.shorten(finding.line, LONGEST, placeholder=" ..."))
    if finding.bound:
        yield _labelled("", f"bound {PURPOSES.get(finding.kind, 'that avoids it')}: {finding.bound}")
    if finding.fix:
        yield _labelled("", f"fix: {finding.fix} (simmatrix known {finding.causes[0]})")
    if finding.kind is Kind.GOOD:
        day = (finding.measured or "")[:10]
        yield _labelled("", f"measured {day} on Python {finding.python}: simmatrix show {finding.cells[0]}")
    elif finding.next:
        yield _labelled("", finding.next)


def _labelled(label: str, text: str) -> str:
    return labelled(label, text, WIDTH)

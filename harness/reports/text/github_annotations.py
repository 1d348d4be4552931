"""Write annotations for GitHub, shown beside a log, and a job summary within GitHub's limit."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from harness.model import Verdict
from harness.model.report_types import SEVERITY, CellEntry, Document, format_count, word
from harness.standalone.control_characters import strip_controls

SHOWN = 10
"""Errors of one step that GitHub shows; it drops the others without a word."""

SUMMARY = 1024 * 1024
"""Bytes that a step may add to a job's summary; GitHub drops a longer one as a whole."""

NAMED = 20
"""Cells that one annotation names; the report names them all."""

CUT = "\n\nThis page is cut off here, at the platform's limit; the whole one is in the uploaded report.\n"


@dataclass(frozen=True, kw_only=True, slots=True)
class Annotation:
    """One problem: of a cell, of several cells for the same reason, or of an expectation."""

    title: str
    message: str


def github(document: Document, fail_on: Collection[str]) -> str:
    """Return one workflow command per reason to fail, worst first, at most as many as GitHub shows."""
    wrong = tuple(reasons(document, fail_on))
    if len(wrong) > SHOWN:
        rest = format_count(len(wrong) - SHOWN + 1, "more reason")
        closing = Annotation(title=f"and {rest} to fail", message="All of them are in the summary and in the report.")
        wrong = (*wrong[: SHOWN - 1], closing)
    # The value of a property has two more characters to escape than the message.
    titles = (_data(one.title).replace(":", "%3A").replace(",", "%2C") for one in wrong)
    return "".join(f"::error title={title}::{_data(one.message)}\n" for title, one in zip(titles, wrong, strict=True))


def reasons(document: Document, fail_on: Collection[str]) -> Iterator[Annotation]:
    """Yield the reasons why a report fails: cells not as expected (worst first), then stale expectations.

    Last come inconclusive cells, and those with a verdict that `fail_on` names.
    """
    several = len(document.machines) > 1
    if "unexpected" in fail_on:
        yield from _alike([cell for cell in document.cells if cell.as_expected is False], several=several)
    if "stale" in fail_on:
        yield from (Annotation(title="expectation out of date", message=sentence) for sentence in document.stale)
    # An inconclusive cell fails the step whatever `fail_on` names (exit code 3), so it is always named here.
    untold = {Verdict.INCONCLUSIVE, *(verdict for verdict in Verdict if verdict in fail_on)}
    yield from _alike([cell for cell in document.cells if cell.verdict in untold], several=several)


def _alike(cells: Iterable[CellEntry], *, several: bool) -> Iterator[Annotation]:
    """Yield one annotation per reason, with the cells that have it."""
    groups: dict[tuple[str, str], list[str]] = {}
    for cell in sorted(cells, key=lambda cell: SEVERITY.index(cell.verdict)):
        place = f"{cell.id} on {cell.machine}" if several and cell.machine else cell.id
        groups.setdefault((_describe_result(cell), cell.decisive or ""), []).append(place)
    for (result, decisive), places in groups.items():
        more = f" and {format_count(len(places) - 1, 'more cell')}" if len(places) > 1 else ""
        named = places[1:NAMED] + [f"and {format_count(len(places) - NAMED, 'more cell')}"] * (len(places) > NAMED)
        also = "\n".join(["", "also:", *named]) if more else ""
        yield Annotation(title=places[0] + more, message=(f"{result}: {decisive}" if decisive else result) + also)


def _describe_result(cell: CellEntry) -> str:
    at = f" in {cell.phase}" if cell.phase else ""
    expectation = cell.expectation
    if cell.as_expected is not False or expectation is None:
        return f"{word(cell.verdict)}{at}"
    phase = f" in {expectation.phase}" if expectation.phase else ""
    return f"{word(cell.verdict)}{at}, where the matrix expects {word(expectation.verdict)}{phase}"


def _data(text: str) -> str:
    """Escape text for the message of a workflow command."""
    return strip_controls(text).replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def summary(page: str, limit: int = SUMMARY) -> str:
    """Return the page, cut at the end of a line if it is longer than `limit` bytes."""
    content = page.encode()
    if len(content) <= limit:
        return page
    room = content[: limit - len(CUT.encode())]
    # The cut in bytes may split a character; up to the last line end all of them are whole.
    return room[: room.rfind(b"\n") + 1].rstrip(b"\n").decode() + CUT

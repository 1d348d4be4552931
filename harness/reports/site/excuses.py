"""Say of a red square what must happen for it to turn green, and who can do it; find the nearest one that works."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from harness.judging.known_failures import select_counting
from harness.matrix.signatures import Signature
from harness.model import Verdict
from harness.model.report_types import CellEntry, DiagnosisEntry
from harness.model.vocabulary import required_name
from harness.physics.families import moved_packages
from harness.standalone.failures.remedies import describe_steps
from harness.standalone.keys import weight

Moved = dict[str, tuple[str | None, str | None]]

YOU = "You"
NEXT = "Anyone who runs it again"


@dataclass(frozen=True, kw_only=True, slots=True)
class Nearest:
    """The nearest cell that works, with what differs there: each name with the version here and the version there."""

    cell: CellEntry
    differs: Moved


@dataclass(frozen=True, kw_only=True, slots=True)
class Excuse:
    """One way in which a square turns green: who can do it, what to do, and the cell that proves it if there is one."""

    who: str
    text: str
    proof: str = ""


def nearest(entry: CellEntry, others: Iterable[CellEntry]) -> Nearest | None:
    """Return the cell that works and differs least: in few axes, and then in few packages."""
    good = [other for other in others if other.good and other.id != entry.id]
    axes = [_axes_apart(entry, other) for other in good]
    fewest = min(axes, default=0)
    least = [other for other, count in zip(good, axes, strict=True) if count == fewest]
    mine = set((entry.installed or {}).items())
    best = min(least, key=lambda other: len(mine ^ set((other.installed or {}).items())) if mine else 0, default=None)
    return Nearest(cell=best, differs=differences(entry, best)) if best else None


def _axes_apart(entry: CellEntry, other: CellEntry) -> int:
    """Return the number of axes in which two cells differ."""
    names = entry.axes.keys() | other.axes.keys()
    return sum(entry.axes.get(name) != other.axes.get(name) for name in names)


def differences(entry: CellEntry, other: CellEntry) -> Moved:
    """Return what differs between two cells: Python, variables, packages if both have any, else axes."""
    moved: Moved = {}
    if entry.installed and other.installed:
        moved = moved_packages(entry.installed, other.installed)
    else:
        moved = {name: pair for name, pair in moved_packages(entry.axes, other.axes).items() if name != "python"}
    variables = moved_packages(_variables(entry), _variables(other))
    here, there = (cell.python or cell.requested_python for cell in (entry, other))
    python: Moved = {"Python": (here, there)} if here != there else {}
    return {**python, **variables, **moved}


def heaviest_first(moved: Moved) -> list[tuple[str, tuple[str | None, str | None]]]:
    """Return what differs, the packages first that people choose for their own sake."""
    return sorted(moved.items(), key=lambda pair: (-weight(pair[0]), pair[0]))


def _variables(cell: CellEntry) -> dict[str, str]:
    return {**cell.environment, **cell.supplied}


def excuses(entry: CellEntry, near: Nearest | None, signatures: Mapping[str, Signature]) -> list[Excuse]:
    """Return the ways in which a cell can turn green, the surest first; none for a cell that works."""
    match entry.verdict:
        case Verdict.WORKS:
            return [Excuse(who=NEXT, text=_verify(name)) for name in entry.doubts]
        case Verdict.UNAVAILABLE:
            text = "This machine lacks a part that the combination needs. Run the command below on one that has it."
            return [Excuse(who="Somebody with another machine", text=text)]
        case Verdict.INCONCLUSIVE | Verdict.NOT_RUN:
            text = "This machine could not decide it. Run the command below: a clear result replaces this one."
            return [Excuse(who=NEXT, text=text)]
        case _:
            return [*_fixes(entry, signatures), *_way_around(near), *_unknown(entry)]


def _verify(name: str) -> str:
    return f"A silent known issue, `{name}`, was neither shown nor excluded here. A check that excludes it is needed."


def _fixes(entry: CellEntry, signatures: Mapping[str, Signature]) -> Iterator[Excuse]:
    for diagnosis in select_counting(entry)[:1]:
        steps = "; ".join(describe_steps(diagnosis.remedy))
        signature = signatures.get(diagnosis.signature)
        who = YOU if signature is None or signature.phases else "The administrator of the machine"
        if steps:
            measured = "This was measured, and works." if diagnosis.proof else "Nobody has measured this fix here yet."
            yield Excuse(who=who, text=f"{_sentence(steps)} {measured}", proof=diagnosis.proof or "")
        text = str(diagnosis.remedy.get("text", ""))
        if text:
            yield Excuse(who=who, text=_sentence(text))
        yield from _maintainers(diagnosis, signature)


def _maintainers(diagnosis: DiagnosisEntry, signature: Signature | None) -> Iterator[Excuse]:
    packages = [required_name(part[0]) for part in signature.packages] if signature else []
    names = " or ".join(dict.fromkeys(packages))
    if names:
        text = (
            "A new release without this cause gets a square of its own. "
            "This square keeps its versions, and so it stays red."
        )
        about = " They can start from the references above." if diagnosis.references else ""
        yield Excuse(who=f"The maintainers of {names}", text=text + about)


def _way_around(near: Nearest | None) -> Iterator[Excuse]:
    if near:
        names = [f"{name} {there}" if there else f"no {name}" for name, (_, there) in heaviest_first(near.differs)]
        more = f" and {len(names) - 4} more" if len(names) > 4 else ""
        text = f"Take the nearest combination that works: {', '.join(names[:4])}{more}." if names else ""
        yield Excuse(who=YOU, text=text or "Take the nearest combination that works.", proof=near.cell.id)


def _unknown(entry: CellEntry) -> Iterator[Excuse]:
    if not select_counting(entry):
        text = "No known issue fits, so somebody has to find the cause first. `simmatrix repair` searches for a fix."
        yield Excuse(who="Anyone", text=text)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."

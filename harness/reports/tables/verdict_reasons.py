"""Explain in words why cells are not green: reasons, known causes, what hid them, and changes that were tried."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from harness.judging.known_failures import select_counting
from harness.model import Verdict
from harness.model.cellid import CellId
from harness.model.report_types import CellEntry, word
from harness.reports.tables import change_effects
from harness.reports.tables.table_types import Attempt, Cause, Effect, Explanation
from harness.standalone.failures.remedies import in_words

NOTHING = "-"


def reasons(cells: Iterable[CellEntry]) -> Iterator[tuple[Explanation, list[CellEntry]]]:
    """Yield each reason with the results that have it, for all cells that need an explanation."""
    groups: dict[tuple[Any, ...], list[CellEntry]] = {}
    results: Counter[str] = Counter()
    locks: dict[str, str] = {}
    for cell in cells:
        results[cell.id] += 1
        locks[cell.id] = cell.lock or ""
        # A changed cell is shown among the changes tried (`attempts`); here it stands only if it is not as expected.
        if not (plain(cell) or (cell.change and cell.as_expected is not False)):
            link = cell.expectation.link or "" if cell.expectation else ""
            ids = tuple(one.signature for one in select_counting(cell))
            why = failed_in(cell), cell.decisive or "", hidden_by(cell), expectation(cell), link, ids
            groups.setdefault((cell.verdict, *why), []).append(cell)
    for (verdict, phase, decisive, hidden, expected, link, _), group in groups.items():
        explanation = Explanation(
            verdict=verdict,
            phase=phase,
            decisive=decisive,
            hidden_by=hidden,
            expected=expected,
            link=link,
            cells=_labels(group, results),
            causes=tuple(_causes(group, locks)),
        )
        yield explanation, group


def _causes(cells: Sequence[CellEntry], locks: Mapping[str, str]) -> Iterator[Cause]:
    """Yield the known failures of cells that all have the same ones."""
    for place, diagnosis in enumerate(select_counting(cells[0])):
        proofs = [proof for cell in cells if (proof := select_counting(cell)[place].proof)]
        yield Cause(
            signature=diagnosis.signature,
            cause=diagnosis.cause,
            remedy=in_words(diagnosis.remedy),
            applicable=any(key != "text" for key in diagnosis.remedy),
            proofs=tuple((CellId.parse(proof).label, locks.get(proof, "")) for proof in dict.fromkeys(proofs)),
            references=diagnosis.references,
        )


def describe_cause(cell: CellEntry) -> dict[str, Any]:
    """Return the fields of a row on the deepest known cause and its remedy; empty if no cause is known."""
    deepest = next(iter(select_counting(cell)), None)
    if deepest is None:
        return {}
    proof = f" (proven by {CellId.parse(deepest.proof).label})" if deepest.proof else ""
    remedy = in_words(deepest.remedy) + proof
    return {"cause": deepest.cause, "remedy": remedy, "proven": deepest.proven, "known": deepest.signature}


def attempts(cells: Sequence[CellEntry]) -> Iterator[Attempt]:
    """Yield each change that was tried, with the cell that it was tried on, on the same machine."""
    cells_by_key = {(cell.id, cell.machine): cell for cell in cells}
    for after in cells:
        if after.change is None or after.base is None or after.verdict is Verdict.NOT_RUN:
            continue
        before = cells_by_key.get((after.base, after.machine))
        yield Attempt(
            cell=CellId.parse(after.base).label,
            before=_stands(before) if before else "not run",
            change=after.change.name,
            does=after.change.does,
            reason=after.change.reason,
            advice=after.change.advice,
            link=after.change.link or "",
            after=_stands(after),
            effect=change_effects.effect(before, after) if before else Effect.UNTOLD,
            lock=after.lock or "",
            machine=after.machine or NOTHING,
        )


def _stands(cell: CellEntry) -> str:
    """Describe the result of a cell: its verdict, the phase, and the decisive line."""
    where = f" in {failed_in(cell)}" if failed_in(cell) else ""
    line = f": {cell.decisive}" if cell.decisive and cell.verdict is not Verdict.WORKS else ""
    return f"{word(cell.verdict)}{where}{line}"


def _labels(cells: Iterable[CellEntry], results: Mapping[str, int]) -> tuple[str, ...]:
    """Return each cell once; with the machines that found this, if others found something else."""
    machines: dict[str, list[str]] = {}
    for cell in cells:
        machines.setdefault(cell.id, []).append(cell.machine or NOTHING)
    return tuple(
        CellId.parse(cell_id).label + ("" if len(found) == results[cell_id] else f" on {', '.join(found)}")
        for cell_id, found in machines.items()
    )


def hidden_by(cell: CellEntry) -> tuple[str, ...]:
    """Return the errors that hid the causes of a cell's failures, each with its check."""
    return tuple(dict.fromkeys(f"{mask} ({check})" for case in cell.cases for check, mask in case.masked.items()))


def expectation(cell: CellEntry) -> str:
    """Return a sentence on the expectation of a cell, with its reason; empty if it was not judged."""
    expect = cell.expectation
    if cell.as_expected is None:
        return ""
    if expect is None:
        return "as expected" if cell.as_expected else "not expected"
    if cell.as_expected:
        return f"as expected: {expect.reason}"
    where = f" in {expect.phase}" if expect.phase else ""
    match = f" with a line like {expect.match!r}" if expect.match else ""
    match += f" with {expect.code} observed" if expect.code else ""
    match += f" by {expect.signature}" if expect.signature else ""
    return f"not as expected, which was {word(expect.verdict)}{where}{match}: {expect.reason}"


def plain(cell: CellEntry) -> bool:
    """Return whether a cell needs no explanation: it is green or was not run, and nobody expected otherwise."""
    return cell.verdict in {Verdict.WORKS, Verdict.NOT_RUN} and cell.as_expected is not False


def failed_in(cell: CellEntry) -> str:
    """Return the phase in which a cell failed; empty for a cell that is unavailable on this machine."""
    return "" if cell.verdict is Verdict.UNAVAILABLE else cell.phase or ""

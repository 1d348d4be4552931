"""Merge reports of shards and machines into one.

The result does not depend on the order of the reports, on repetitions, or on which of them were merged before. If a
cell was measured more than once on one machine, a verdict about the packages goes before one that says nothing about
them (a newer `inconclusive` does not undo a known result). Then the newer goes before the older.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import msgspec

from harness.judging.expectation import reason_stale
from harness.model import Dropped, Verdict
from harness.model.errors import BadInput
from harness.model.report_types import UNTOLD, CellEntry, Document, word
from harness.reports import document
from harness.reports.tables import change_effects

MARK = re.compile(r"~[0-9a-f]{8}(?=(?:\.[^./]*)?$)")
"""What tells files of one name and several contents apart."""

DEFINING_FIELDS = ("matrix", "axes", "requested_python", "environment", "expectation")
"""What a cell is; two reports that differ in it were made of two states of a matrix."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Source:
    """A report and the name of its file, for messages. Its paths are tokens: path and content."""

    name: str
    document: Document


def merge(sources: Sequence[Source]) -> Document:
    """Merge several documents into one. Raises BadInput if they answer different questions."""
    _check_alike(sources)
    documents = [source.document for source in sources]
    cells = _cells(documents)
    planned = {cell.id for cell in cells}
    generated = max(made.generated for made in documents)
    return Document(
        generated=generated,
        machines=_machines(documents),
        # Proofs are marked again: one shard may hold the red cell and another the cell that proves its remedy.
        cells=change_effects.mark_proven(cells),
        dropped=tuple(_dropped(documents, planned)),
        matrices={name: matrix for made in documents for name, matrix in made.matrices.items()},
        stale=_stale(documents, cells, planned, generated),
        probes={name: probe for made in documents for name, probe in made.probes.items()},
    )


# --- cells -----------------------------------------------------------------------------------------------------


def _cells(documents: Iterable[Document]) -> list[CellEntry]:
    """Return the best entry of each cell on each machine; a cell that nobody ran has one entry, without a machine."""
    best: dict[str, dict[str, CellEntry]] = {}
    orders: dict[str, set[tuple[str, ...]]] = {}
    for report in documents:
        listed: dict[str, dict[str, None]] = {}
        for entry in report.cells:
            listed.setdefault(entry.matrix, {})[entry.id] = None
            # `document.build` gives a cell that never ran the shard's only machine, which says nothing of that machine.
            unrun = entry.verdict is Verdict.NOT_RUN and not entry.measured
            cell = msgspec.structs.replace(entry, machine=None) if unrun else entry
            of_machine = best.setdefault(cell.id, {})
            of_machine[cell.machine or ""] = max(of_machine.get(cell.machine or "", cell), cell, key=_worth)
        for matrix, ids in listed.items():
            orders.setdefault(matrix, set()).add(tuple(ids))
    names = [cell_id for matrix in sorted(orders) for cell_id in _ordered(orders[matrix])]
    # An entry without a machine is listed only if no machine ran the cell.
    entries = ((best[cell_id], entry) for cell_id in names for _, entry in sorted(best[cell_id].items()))
    return [entry for of_machine, entry in entries if entry.machine or len(of_machine) == 1]


def _worth(cell: CellEntry) -> tuple[bool, bool, str, bool, bytes]:
    """Return a sort key: the greatest entry is kept. The content decides if nothing else does."""
    conclusive, ran = cell.verdict not in UNTOLD, cell.verdict is not Verdict.NOT_RUN
    content = msgspec.json.encode(cell, order="deterministic")
    return conclusive, ran, cell.measured or "", not cell.reused, content


def _ordered(orders: set[tuple[str, ...]]) -> list[str]:
    """Return the ids in the order of the plan; if reports list different cells, all of them sorted by name."""
    if len(orders) == 1:
        return list(next(iter(orders)))
    return sorted({name for order in orders for name in order}, key=natural)


def natural(name: str) -> tuple[list[str | int], str]:
    """Return a sort key that compares numbers by their size: 3.9 before 3.11."""
    return [int(part) if part.isdigit() else part for part in re.split(r"([0-9]+)", name)], name


# --- what stands beside them -----------------------------------------------------------------------------------


def _dropped(documents: Iterable[Document], planned: set[str]) -> list[Dropped]:
    """Return the combinations that were left out, except those that some report has as a cell."""
    entries: dict[str, Dropped] = {}
    orders = set()
    for report in documents:
        gone = [entry for entry in report.dropped if entry.id not in planned]
        orders |= {tuple(entry.id for entry in gone)} - {()}
        for entry in gone:
            # min() takes the same entry in whatever order the reports come.
            entries[entry.id] = min(
                entries.get(entry.id, entry), entry, key=lambda candidate: (candidate.reason, candidate.count)
            )
    return [entries[name] for name in (_ordered(orders) if orders else ())]


def _machines(documents: Iterable[Document]) -> dict[str, dict[str, Any]]:
    """Return the facts of each class of machines in which all of its machines agree."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for report in documents:
        for name, facts in report.machines.items():
            groups.setdefault(name, []).append(facts)
    return {
        name: {key: fact for key, fact in first.items() if all(key in one and one[key] == fact for one in others)}
        for name, (first, *others) in sorted(groups.items())
    }


def _stale(documents: Iterable[Document], cells: Iterable[CellEntry], planned: set[str], today: str) -> tuple[str, ...]:
    """Return sentences about stale expectations: of the matrices, and of the merged cells, not as a shard saw them."""
    # A sentence about a cell begins with its id. It is made anew, as another shard may have replaced the result.
    sentences = {text for made in documents for text in made.stale if text.partition(" ")[0] not in planned}
    of_cells = {reason_stale(cell.id, cell.verdict, cell.expectation, today) for cell in cells if cell.expectation}
    return tuple(sorted(sentences | {text for text in of_cells if text}, key=natural))


# --- whether they belong together ------------------------------------------------------------------------------


def _check_alike(sources: Iterable[Source]) -> None:
    """Refuse reports that answer different questions or were measured in different ways. Raises BadInput."""
    definitions: dict[tuple[str, str], tuple[str, Any]] = {}
    for source in sources:
        for (what, of), value in _list_definitions(source.document):
            before, other = definitions.setdefault((what, of), (source.name, value))
            if value != other:
                cause, remedy = (
                    ("by another simmatrix", "one version of it")
                    if what == "probes"
                    else ("of another state of the matrix", "one state of it")
                )
                message = (
                    f"{source.name}: made {cause} than {before}: the {word(what)} of {of} differ;"
                    f" measure again what was measured before, with {remedy}"
                )
                raise BadInput(message)


def _list_definitions(report: Document) -> Iterator[tuple[tuple[str, str], Any]]:
    """Yield the facts in which reports must agree: of each cell its definition, of each matrix its axes."""
    for cell in report.cells:
        yield from (((name, cell.id), getattr(cell, name)) for name in DEFINING_FIELDS)
        if cell.requirements:
            yield ("requirements", cell.id), cell.requirements
        if cell.asked:
            yield ("packages and cases", cell.id), cell.asked
        if cell.subject:
            yield ("state of the subject", cell.id), (cell.subject.commit, cell.subject.changed)
        # A cell that was not run lists no cases, and this makes it no other question.
        if cell.cases:
            yield ("cases", cell.id), [(case.case, case.env, case.api) for case in cell.cases]
    yield from ((("axes", name), (matrix.axes, matrix.shown)) for name, matrix in report.matrices.items())
    yield from ((("snapshot", name), matrix.snapshot) for name, matrix in report.matrices.items())
    yield from ((("probes", name), probe) for name, probe in report.probes.items())


# --- files -----------------------------------------------------------------------------------------------------


def token(path: str, content: str) -> str:
    """Return a token for a file or folder: its path without a mark, and the hash of its content."""
    # An earlier merge may have added the mark. Without it, merging again gives the same names.
    return f"{MARK.sub('', path)}\0{content}"


def assign_paths(report: Document) -> tuple[Document, dict[str, str]]:
    """Return the document with paths for tokens, and the path of each token: equal files are stored once."""
    contents: dict[str, list[str]] = {}
    for token in sorted(document.paths(report)):
        contents.setdefault(token.partition("\0")[0], []).append(token)
    names = {
        known: path if len(tokens) == 1 else _marked(path, known.partition("\0")[2])
        for path, tokens in contents.items()
        for known in tokens
    }
    return document.relocate(report, lambda path_token: names[path_token]), names


def _marked(path: str, content: str) -> str:
    pure = PurePosixPath(path)
    return str(pure.with_name(f"{pure.stem}~{content[:8]}{pure.suffix}"))

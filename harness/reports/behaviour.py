"""Add behaviour to a document: the family of each case in each cell, and the boundaries between releases.

Cells are compared case by case, from the outputs that their probe runs left. Nothing is measured. Consequences are what
a change does to a policy that played in both cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import msgspec

from harness.model import Case, CaseRecord, CellRecord, Phase, Plan
from harness.model.hostile_data import Unreadable
from harness.model.report_types import (
    BehaviourEntry,
    BoundaryEntry,
    CaseEntry,
    CellEntry,
    ConsequenceEntry,
    Document,
)
from harness.physics import families, sentences
from harness.physics.comparison import compare
from harness.physics.consequence import Play, consequence
from harness.physics.outputs import Bank, Outputs
from harness.physics.relation import Class, Comparison
from harness.probes import array_files
from harness.probes.evidence import GIVEN, OUTPUTS, PLAYED
from harness.probes.vault import MOST_FILE, Vault
from harness.reports import changelogs
from harness.running import behaviour_runs

OUTPUT_OF = {"observation": "observation", "reward": "reward", "ended": "termination"}
"""Outputs whose class a case entry names, by the name of it there; the dynamics and the start come with them."""


def add(document: Document, records: Sequence[CellRecord], plans: Sequence[Plan], vault: Vault) -> Document:
    """Return the document with the behaviour of its cases, and with consequences; the same one where there is none."""
    consequences = tuple(_consequences(records, plans, vault))
    document = msgspec.structs.replace(document, consequences=consequences) if consequences else document
    measured = _measured(records, vault)
    if not measured:
        return document
    entries: dict[tuple[str, str, str], BehaviourEntry] = {}
    comparison: list[BoundaryEntry] = []
    orders = {plan.matrix: _order(plan) for plan in plans}
    for key, cases in measured.items():
        task = _Task(cases, vault)
        for cell, entry in task.entries(orders.get(key[0], {})):
            entries[cell, key[1], key[2]] = entry
        comparison += task.boundaries
    replace = msgspec.structs.replace

    def case(cell: CellEntry, case_run: CaseEntry) -> CaseEntry:
        entry = entries.get((cell.id, cell.machine or "", case_run.case))
        return replace(case_run, behaviour=entry) if entry else case_run

    cells = tuple(replace(cell, cases=tuple(case(cell, one) for one in cell.cases)) for cell in document.cells)
    return replace(document, cells=cells, boundaries=tuple(comparison) or msgspec.UNSET)


Exercised = Literal["contact", "limit", "equality"]


@dataclass(frozen=True, slots=True)
class _Measured:
    """A case of a cell: the names of its outputs and of its bank in the vault."""

    record: CellRecord
    case: CaseRecord
    outputs: str
    bank: str


def _measured(records: Iterable[CellRecord], vault: Vault) -> dict[tuple[str, str, str], list[_Measured]]:
    """Return what was stepped from a bank, by matrix, machine and case."""
    comparison: dict[tuple[str, str, str], list[_Measured]] = {}
    for record in records:
        for case in record.cases:
            behaves = any(phase.phase is Phase.BEHAVE for phase in case.phases)
            names = _files(case, vault) if behaves else None
            if names:
                key = record.cell.matrix, record.machine, case.case
                comparison.setdefault(key, []).append(_Measured(record, case, *names))
    return comparison


def _files(case: CaseRecord, vault: Vault) -> tuple[str, str] | None:
    for run in reversed(case.runs):
        try:
            files = vault.files(run)
        except Unreadable:
            continue
        if OUTPUTS in files and GIVEN in files:
            return files[OUTPUTS], files[GIVEN]
    return None


def _order(plan: Plan) -> dict[str, tuple[object, ...]]:
    """Return the place of each cell: axis by axis, releases in their order."""
    return {
        cell.id: tuple(families.release_order(cell.axes.get(axis, "")) for axis in plan.axes) for cell in plan.cells
    }


@dataclass
class _Task:
    """One case in all cells of a matrix on one machine."""

    measured: list[_Measured]
    vault: Vault
    boundaries: list[BoundaryEntry] = field(default_factory=list)
    _outputs: dict[str, Outputs] = field(default_factory=dict)
    _banks: dict[str, Bank] = field(default_factory=dict)
    _comparisons: dict[tuple[str, str], Comparison] = field(default_factory=dict)

    def entries(self, order: Mapping[str, tuple[object, ...]]) -> Iterator[tuple[str, BehaviourEntry]]:
        """Yield the behaviour of each cell, in the order of the plan; fill `boundaries`."""
        by_cell = {one.record.cell.id: one for one in self.measured}
        cells = sorted(by_cell, key=lambda cell: (order.get(cell, ()), cell))

        def between(case_run: str, neighbour: str) -> Comparison:
            return self._compare(by_cell[case_run], by_cell[neighbour])

        letters = families.families(cells, between)
        neighbours = self._along_axes(by_cell, cells, between)
        for cell in cells:
            reference, sentence = neighbours.get(cell, (None, None))
            comparison = between(cell, reference) if reference else None
            yield (
                cell,
                BehaviourEntry(
                    bank=by_cell[cell].bank,
                    family=letters[cell],
                    method="seeded" if self._load(by_cell[cell].outputs).facts.get("method") == "seeded" else "states",
                    coverage=_coverage(self._load(by_cell[cell].outputs)),
                    reference=reference,
                    classes=_classes(comparison) if comparison else {},
                    boundary=sentence,
                ),
            )

    def _along_axes(
        self, by_cell: Mapping[str, _Measured], cells: Sequence[str], between: families.Compare
    ) -> dict[str, tuple[str | None, str | None]]:
        """Return each cell's neighbour before it on an axis, with a sentence where they differ; keep the boundaries."""
        axes = {cell: dict(by_cell[cell].record.cell.axes) for cell in cells}
        packages = [axis for axis in next(iter(axes.values())) if axis != "python"]
        neighbours: dict[str, tuple[str | None, str | None]] = {}
        for axis in packages:
            lines: dict[tuple[tuple[str, str], ...], dict[str, str]] = {}
            for cell in cells:
                rest = tuple(sorted((name, value) for name, value in axes[cell].items() if name != axis))
                lines.setdefault(rest, {})[axes[cell][axis]] = cell
            for line in lines.values():
                values = sorted(line, key=families.release_order)
                for before, after in pairwise(values):
                    neighbours.setdefault(line[after], (line[before], None))
                installed = {cell: by_cell[cell].record.installed or {} for cell in line.values()}
                for boundary in families.boundaries(axis, values, line, installed, between):
                    entry = self._boundary(boundary, by_cell[boundary.cells[1]])
                    self.boundaries.append(entry)
                    neighbours[boundary.cells[1]] = (boundary.cells[0], entry.text)
        return neighbours

    def _boundary(self, boundary: families.Boundary, case_run: _Measured) -> BoundaryEntry:
        comparison, leading = boundary.comparison, sentences.leading_difference(boundary.comparison)
        return BoundaryEntry(
            matrix=case_run.record.cell.matrix,
            case=case_run.case.case,
            env=case_run.case.env,
            axis=boundary.axis,
            before=boundary.before,
            after=boundary.after,
            cells=boundary.cells,
            kind=comparison.kind,
            start=comparison.start,
            stage=comparison.stage,
            output=leading.output if leading else None,
            largest=leading.largest if leading else 0.0,
            median=leading.median if leading else 0.0,
            share=leading.share if leading else 0.0,
            moved=dict(boundary.others),
            between=boundary.between,
            text=sentences.describe(comparison),
            changelog=changelogs.look_up_moved(boundary.axis, (*boundary.between, boundary.after), boundary.moved),
        )

    def _compare(self, case_run: _Measured, neighbour: _Measured) -> Comparison:
        """Compare two cells; cells with equal outputs are compared once."""
        key = case_run.outputs, neighbour.outputs
        if key not in self._comparisons:
            if case_run.bank != neighbour.bank:
                kind = Class.NOT_COMPARABLE
                self._comparisons[key] = Comparison(kind=kind, dynamics=kind, start=kind)
            else:
                outputs = self._load(case_run.outputs), self._load(neighbour.outputs)
                self._comparisons[key] = compare(*outputs, self._bank(case_run))
        return self._comparisons[key]

    def _load(self, name: str) -> Outputs:
        if name not in self._outputs:
            arrays = array_files.decode(self.vault.content(name, MOST_FILE))
            self._outputs[name] = Outputs(arrays, array_files.facts(arrays))
        return self._outputs[name]

    def _bank(self, case_run: _Measured) -> Bank:
        if case_run.bank not in self._banks:
            self._banks[case_run.bank] = behaviour_runs.read_bank(case_run.bank, self.vault)
        return self._banks[case_run.bank]


def _coverage(outputs: Outputs) -> dict[Exercised, float] | msgspec.UnsetType:
    """Return the share of the states in which each kind of constraint had a row in the solver."""
    if "rows" not in outputs.arrays:
        return msgspec.UNSET
    shares = (outputs.arrays["rows"] > 0).mean(axis=0)
    kinds: tuple[Exercised, ...] = ("equality", "limit", "contact")
    return {kind: round(float(share), 3) for kind, share in zip(kinds, shares, strict=True)}


def _classes(comparison: Comparison) -> dict[str, str]:
    classes = {"sum": comparison.kind, "dynamics": comparison.dynamics, "start": comparison.start}
    classes |= {name: comparison.of(output).kind for output, name in OUTPUT_OF.items()}
    return {name: str(kind) for name, kind in classes.items()}


# --- consequences ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Played:
    """A case of a cell with the episodes that its policy played."""

    record: CellRecord
    case: Case
    play: Play


def _consequences(records: Iterable[CellRecord], plans: Sequence[Plan], vault: Vault) -> Iterator[ConsequenceEntry]:
    """Yield the consequence of each step from a release to the next in which a policy played, task by task."""
    axes = {plan.matrix: plan.axes for plan in plans}
    tasks: dict[tuple[str, str, str], list[_Played]] = {}
    for record in records:
        cases = {case.id: case for case in record.cell.cases if case.policy}
        for result in record.cases:
            arrays = behaviour_runs.arrays_of(result, PLAYED, vault) if result.case in cases else None
            if arrays:
                play = Play.of(arrays, array_files.facts(arrays))
                key = record.cell.matrix, record.machine, result.case
                tasks.setdefault(key, []).append(_Played(record, cases[result.case], play))
    for key, task in tasks.items():
        for axis in axes.get(key[0], ()):
            if axis != "python":
                yield from _steps(axis, task)


def _steps(axis: str, task: Sequence[_Played]) -> Iterator[ConsequenceEntry]:
    """Yield the consequence of each step along an axis."""
    lines: dict[tuple[tuple[str, str], ...], dict[str, _Played]] = {}
    for played in task:
        values = played.record.cell.axes
        rest = tuple(sorted((name, value) for name, value in values.items() if name != axis))
        lines.setdefault(rest, {})[values[axis]] = played
    for line in lines.values():
        for before, after in pairwise(sorted(line, key=families.release_order)):
            entry = _consequence(axis, (before, after), line[before], line[after])
            if entry:
                yield entry


def _consequence(axis: str, values: tuple[str, str], before: _Played, after: _Played) -> ConsequenceEntry | None:
    """Return the consequence of a step between two releases; None if not the same was played in both."""
    if (before.case.policy, before.case.seed) != (after.case.policy, after.case.seed):
        return None
    effect = consequence(before.play, after.play, (before.case.policy or {}).get("gain"))
    if effect is None:
        return None
    return ConsequenceEntry(
        matrix=before.record.cell.matrix,
        case=before.case.id,
        axis=axis,
        before=values[0],
        after=values[1],
        cells=(before.record.cell.id, after.record.cell.id),
        effect=effect.effect,
        measure=effect.measure,
        episodes=effect.episodes,
        values=(round(effect.before, 4), round(effect.after, 4)),
        difference=round(effect.difference, 2),
        interval=(round(effect.low, 2), round(effect.high, 2)),
        least=round(effect.least, 2),
        moved_starts=effect.moved_starts,
        identical=effect.identical,
        repeats=effect.repeats,
        moved=families.moved_packages(before.record.installed or {}, after.record.installed or {}),
        text=sentences.describe_consequence(effect),
    )

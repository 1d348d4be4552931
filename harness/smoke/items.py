"""The matrix as a tree of pytest items: cell, case, phase. Each cell ends with its verdict."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import Any, Protocol

import pytest

from harness.judging.assess import assess
from harness.judging.runs.check import phase_of
from harness.machine import store
from harness.model import CASE_PHASES, Case, Cell, CellRecord, Phase, Plan, cellid
from harness.model.errors import CouldNotTell, HarnessError, in_the_way
from harness.running.signatures import shipped_signatures
from harness.smoke import judging, junit
from harness.smoke.frozen import SessionPlan
from harness.smoke.judging import ItemOutcome, Kind
from harness.smoke.measuring import STEPS, Measuring, Selection, has_suite


# The plugin in `face` imports this module, so its type cannot be named here.
class Session(Protocol):
    """The part of the plugin that items use: the plan, and the measurements."""

    frozen: SessionPlan
    measuring: Measuring


SESSION = pytest.StashKey[Session]()
VERDICT, EXPECTATIONS = "verdict", "expectations"
MARKERS = {
    **{
        phase.value: f"the phase {phase} of a cell or a case"
        for phase in (Phase.RESOLVE, Phase.INSTALL, *CASE_PHASES, Phase.SUITE)
    },
    VERDICT: "a cell as a whole against what is expected of it",
    EXPECTATIONS: "expectations that match no cell",
}


class NotAsExpected(Exception):
    """The failure of an item, shown without a traceback, which would be of our own code."""


class OutcomeItem(pytest.Item):
    """An item that measures, and reports the outcome to pytest. `seconds` is the duration of its own part."""

    seconds = 0.0

    def measured(self) -> ItemOutcome:
        """Measure, and return the outcome. Subclasses implement it."""
        raise NotImplementedError

    def _ended(self) -> ItemOutcome:
        """Measure, and return the outcome; errors become outcomes, and only bugs keep their traceback.

        Trouble of this machine is inconclusive: it says nothing about packages.
        """
        try:
            return self.measured()
        except CouldNotTell as error:
            return ItemOutcome(kind=Kind.INCONCLUSIVE, text=f"inconclusive: {error}")
        except HarnessError as error:
            return ItemOutcome(kind=Kind.FAILED, text=str(error))
        except OSError as error:
            machine = in_the_way(error)
            if machine is None:
                raise
            return ItemOutcome(kind=Kind.INCONCLUSIVE, text=f"inconclusive: {machine}")

    def runtest(self) -> None:
        """Measure, and report the outcome to pytest."""
        measuring, began = self.config.stash[SESSION].measuring, monotonic()
        before = measuring.credit
        ended = self._ended()
        elsewhere = measuring.credit - before  # what was measured in the same go has its time in its own item
        self.seconds = max(0.0, monotonic() - began - elsewhere) + ended.seconds
        match ended.kind:
            case Kind.PASSED:
                return
            case Kind.SKIPPED:
                pytest.skip(ended.text)
            case Kind.XFAILED:
                pytest.xfail(ended.text)
            case Kind.FAILED | Kind.INCONCLUSIVE:
                place = ended.evidence and f"evidence: {os.path.relpath(measuring.store.folder / ended.evidence)}"
                raise NotAsExpected("\n".join(filter(None, (ended.text, place))))

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the place of the item. It lies in no file, so the place in its node id stands for one."""
        place, *names = self.nodeid.split("::")
        return self.config.rootpath / place, None, " ".join((place, *names))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the text of a failure without a traceback. A bug of ours keeps its own."""
        if not isinstance(excinfo.value, NotAsExpected):
            return super().repr_failure(excinfo, style)
        representation = excinfo.getrepr(style="value")
        # Otherwise pytest's summary would begin with the name of our exception instead of the decisive line.
        if representation.reprcrash:
            representation.reprcrash.message = str(excinfo.value)
        return representation


class CellItem(OutcomeItem):
    """An item of a cell. `facts` describe the cell as measured, `record` is its full record (verdict items only)."""

    def __init__(self, *, cell: Cell, case: Case | None = None, phase: Phase | None = None, **rest: Any) -> None:
        super().__init__(**rest)
        self.cell, self.case, self.phase = cell, case, phase
        self.facts: dict[str, str] = {}
        self.record: CellRecord | None = None
        self.add_marker(self.name)
        self.user_properties.append((junit.CELL, cell.id))

    def read_facts(self, record: CellRecord) -> dict[str, str]:
        """Return the facts of a record for reports: machine, Python, hash of the lock, key of the environment."""
        facts = {"machine": record.machine, "python": record.python, "lock_sha256": record.lock_sha256}
        return {name: value for name, value in {**facts, "environment": record.key}.items() if value}


class PhaseItem(CellItem):
    """The item of one phase: of a case, of the cell itself (resolve, install), or of its package's own tests."""

    def measured(self) -> ItemOutcome:
        """Measure what the phase belongs to, and return the outcome of the phase."""
        measuring = self.config.stash[SESSION].measuring
        assert self.phase
        collect, shown = judging.collect_phases, measuring.selection.phases(self.cell)
        if self.case:
            record, shown = measuring.case(self.cell, self.case), measuring.shown(self.cell, self.case)
        elif self.phase is Phase.SUITE:
            record, collect = measuring.suite(self.cell), judging.collect_suite
            imports = (measuring.selection.phases(self.cell, case.id) & {Phase.IMPORT} for case in self.cell.cases)
            shown = shown.union(*imports)
        else:
            record = measuring.steps(self.cell)
        self.facts = self.read_facts(record)
        return judging.judge_phase(self.cell, self.phase, collect(record), shown, store.now())


class VerdictItem(CellItem):
    """The item that compares the whole cell with its expectation."""

    def measured(self) -> ItemOutcome:
        """Measure and judge the whole cell, and return the outcome."""
        measuring = self.config.stash[SESSION].measuring
        self.record = measuring.whole(self.cell)
        assessment = assess(self.record, shipped_signatures.load_knowledge(measuring.store.folder), store.now())
        self.facts = {**self.read_facts(self.record), "verdict": assessment.verdict.value}
        return judging.judge_cell(assessment)


class ExpectationItem(OutcomeItem):
    """The item for expectations of a matrix that match no cell."""

    def __init__(self, *, plan: Plan, **rest: Any) -> None:
        super().__init__(**rest)
        self.plan = plan
        self.add_marker(EXPECTATIONS)

    def measured(self) -> ItemOutcome:
        """Return a failure that lists the stale expectations, without measuring."""
        return ItemOutcome(kind=Kind.FAILED, text="\n".join(self.plan.stale))


# --- the tree --------------------------------------------------------------------------------------------------


class Suite(pytest.Directory):
    """All cells of all matrices."""

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        """Yield the cells in the order of the plan, then an item for the stale expectations of each matrix."""
        for plan in self.config.stash[SESSION].frozen.plans:
            for cell in plan.cells:
                yield CellNode.from_parent(self, name=cell.id, nodeid=cell.id, cell=cell)
            if plan.stale:
                yield ExpectationItem.from_parent(
                    self, name=EXPECTATIONS, nodeid=f"{plan.matrix}::{EXPECTATIONS}", plan=plan
                )


class CellNode(pytest.Collector):
    """One cell."""

    def __init__(self, *, cell: Cell, **rest: Any) -> None:
        super().__init__(**rest)
        self.cell = cell
        self.extra_keyword_matches.add(cellid.to_old_form(cell))

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        """Yield the steps of the cell, its cases, its suite if it has one, and its verdict."""
        for phase in sorted(STEPS, key=list(Phase).index):
            yield PhaseItem.from_parent(self, name=phase.value, cell=self.cell, phase=phase)
        for case in self.cell.cases:
            yield CaseNode.from_parent(self, name=case.id, cell=self.cell, case=case)
        if has_suite(self.cell):
            yield PhaseItem.from_parent(self, name=Phase.SUITE.value, cell=self.cell, phase=Phase.SUITE)
        yield VerdictItem.from_parent(self, name=VERDICT, cell=self.cell)


class CaseNode(pytest.Collector):
    """One case of a cell."""

    def __init__(self, *, cell: Cell, case: Case, **rest: Any) -> None:
        super().__init__(**rest)
        self.cell, self.case = cell, case

    def collect(self) -> Iterator[pytest.Item]:
        """Yield an item for each phase in which the case has checks."""
        phases = {phase_of(check) for check in self.case.checks}
        for phase in (phase for phase in CASE_PHASES if phase in phases):
            yield PhaseItem.from_parent(self, name=phase.value, cell=self.cell, case=self.case, phase=phase)


def selection(items: Sequence[pytest.Item]) -> Selection:
    """Return the phases that have items in a session, and the cells that it judges."""
    shown: dict[tuple[str, str], frozenset[Phase]] = {}
    for item in items:
        if isinstance(item, CellItem) and item.phase:
            at = (item.cell.id, item.case.id if item.case else "")
            shown[at] = shown.get(at, frozenset()) | {item.phase}
    return Selection(shown=shown, whole=frozenset(item.cell.id for item in items if isinstance(item, VerdictItem)))

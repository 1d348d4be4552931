"""Merging reports: nothing depends on order, repetition or grouping, and nothing is answered for another question."""

from collections.abc import Callable
from functools import reduce
from random import Random
from typing import Any

import msgspec
import pytest
from builders import GENERATED, HERE, MACHINES, case, record
from specimens import quick

from harness.model import (
    Cell,
    CellRecord,
    Dropped,
    Expectation,
    Outcome,
    Phase,
    PhaseRecord,
    Plan,
    Subject,
    Verdict,
    replace,
)
from harness.model.errors import BadInput
from harness.model.report_types import CellEntry, Document
from harness.reports import document, merging

OTHER = "linux-aarch64"
PLAN = quick()[0]
INFRA = PhaseRecord(phase=Phase.RENDER, outcome=Outcome.INFRA, decisive="the disk is full")


def shard(*records: CellRecord, machine: str = HERE, generated: str = GENERATED, plan: Plan = PLAN) -> Document:
    """Return the document that a shard writes after it ran these cells."""
    return document.build(records, [plan], {machine: MACHINES[HERE]}, generated)


def merge(*documents: Document) -> Document:
    """Return the merged document."""
    return merging.merge([merging.Source(name=f"{number}", document=one) for number, one in enumerate(documents)])


def planned_record(number: int, outcomes: str = "pppp", **more: Any) -> CellRecord:
    """Return the record of a cell of the plan, its verdict set by the outcomes of one case."""
    planned = PLAN.cells[number]
    tried = case(outcomes, "ant", **({"render": INFRA} if outcomes.endswith("i") else {}))
    return record(case("pppp", "cartpole"), tried, of=planned, **more)


def verdicts_of(merged: Document, number: int) -> list[tuple[str | None, Verdict]]:
    """Return machine and verdict of each entry of a cell."""
    return [(cell.machine, cell.verdict) for cell in merged.cells if cell.id == PLAN.cells[number].id]


def random_shard(random: Random) -> Document:
    """Return a shard of some cells, with random time, machine and outcome; now and then with files of the same name."""
    machine = random.choice([HERE, OTHER, "darwin-arm64"])
    records = [
        planned_record(
            number,
            random.choice(["pppp", "pppf", "ppff", "pfnn", "fnnn", "pppi"]),
            machine=machine,
            measured=f"2026-11-2{random.randrange(3)}T12:00:00Z",
            reused=random.random() < 0.3,
            lock=merging.token("locks/5f0c.txt", "0" * 8),
        )
        for number in random.sample(range(len(PLAN.cells)), random.randrange(4))
    ]
    cells = PLAN.cells if random.random() < 0.7 else tuple(random.sample(PLAN.cells, len(PLAN.cells) - 1))
    kept = [one for one in records if one.cell in cells]
    stale = random.sample(["quick.toml: exclude[0] matches nothing", "quick.toml: expect[1] matches no cell"], 1)
    plan = Plan(matrix="quick", cells=cells, dropped=PLAN.dropped, axes=PLAN.axes, shown=PLAN.shown, stale=tuple(stale))
    made = shard(*kept, machine=machine, generated=f"2026-11-2{random.randrange(4)}T13:00:00Z", plan=plan)
    facts = {"cpus": random.choice([2, 4]), "os": "Debian 12"}
    return msgspec.structs.replace(made, machines={machine: facts})


@pytest.mark.parametrize("seed", range(40))
def test_order_repetition_and_grouping_do_not_matter(seed: int) -> None:
    """Shards merged in any order, twice, or some of them before the others: one document, byte for byte."""
    random = Random(seed)
    shards = [random_shard(random) for _ in range(random.randrange(2, 6))]
    expected = document.encode(merge(*shards))

    shuffled = random.sample(shards, len(shards))
    cut = random.randrange(1, len(shards))

    assert document.encode(merge(*shuffled)) == expected
    assert document.encode(merge(*shards, *shuffled)) == expected
    assert document.encode(merge(merge(*shuffled[:cut]), merge(*shuffled[cut:]))) == expected
    assert document.encode(reduce(merge, shuffled, shuffled[0])) == expected
    assert document.encode(merge(document.read(expected, "r"))) == expected


class TestCells:
    def test_shards_are_one_report(self) -> None:
        """Each cell from the shard that ran it, in the order of the plan; a gap is one row of no machine."""
        merged = merge(
            shard(planned_record(2), planned_record(0)), shard(planned_record(4, machine=OTHER), machine=OTHER)
        )

        assert [cell.id for cell in merged.cells] == [planned.id for planned in PLAN.cells]
        assert verdicts_of(merged, 0) == [(HERE, Verdict.WORKS)]
        assert verdicts_of(merged, 4) == [(OTHER, Verdict.WORKS)]
        assert verdicts_of(merged, 1) == [(None, Verdict.NOT_RUN)]
        assert sorted(merged.machines) == [OTHER, HERE]

    def test_machines_stand_side_by_side(self) -> None:
        """One machine never covers another's result."""
        merged = merge(shard(planned_record(0)), shard(planned_record(0, "pfnn", machine=OTHER), machine=OTHER))

        assert verdicts_of(merged, 0) == [(OTHER, Verdict.PARTIAL), (HERE, Verdict.WORKS)]

    @pytest.mark.parametrize(
        ("older", "newer", "stands"),
        [
            ("pppp", "pppf", Verdict.PARTIAL),
            ("pppf", "pppp", Verdict.WORKS),
            ("pppp", "pppi", Verdict.WORKS),
            ("pppi", "pppf", Verdict.PARTIAL),
        ],
    )
    def test_measured_twice(self, older: str, newer: str, stands: Verdict) -> None:
        """The newer result stands, unless it says nothing and the older one does."""
        first = shard(planned_record(0, older, measured="2026-11-20T12:00:00Z"))
        second = shard(planned_record(0, newer, measured="2026-11-21T12:00:00Z"))

        assert verdicts_of(merge(second, first), 0) == [(HERE, stands)]

    def test_combination_left_out_by_one_report(self) -> None:
        """A combination that one report plans is a cell, even if another report leaves it out."""
        here = Plan(matrix="quick", cells=PLAN.cells[:2], dropped=(Dropped(id=PLAN.cells[2].id, reason="no"),))
        there = Plan(matrix="quick", cells=PLAN.cells[2:3], dropped=(Dropped(id="quick/z", reason="too old"),))

        merged = merge(shard(plan=here), shard(planned_record(2), plan=there))

        assert verdicts_of(merged, 2) == [(HERE, Verdict.WORKS)]
        assert [gone.id for gone in merged.dropped] == ["quick/z"]

    def test_a_pattern_keeps_how_many_it_stands_for(self) -> None:
        """One line of a strategy can stand for many combinations left out, and keeps their number."""
        plan = replace(PLAN, dropped=(Dropped(id="quick/*", reason="not chosen by pairwise", count=301),))

        merged = merge(shard(planned_record(0), plan=plan), shard(planned_record(1), plan=plan))

        assert [(gone.id, gone.count) for gone in merged.dropped] == [("quick/*", 301)]

    def test_facts_that_differ_in_a_class_of_machines_are_left_out(self) -> None:
        """Two machines of one class: what both have in common is told."""
        small, big = ({"cpus": cpus, "os": "Debian 12"} for cpus in (2, 64))
        one = msgspec.structs.replace(shard(planned_record(0)), machines={HERE: small})
        two = msgspec.structs.replace(shard(planned_record(1)), machines={HERE: big})

        assert merge(one, two).machines == {HERE: {"os": "Debian 12"}}


class TestStale:
    def expecting(self, **more: Any) -> Plan:
        """Return the plan with an expectation for its first cell."""
        expect = Expectation(verdict=Verdict.PARTIAL, reason="known", **more)
        cells = (replace(PLAN.cells[0], expect=expect), *PLAN.cells[1:])
        return replace(PLAN, cells=cells, stale=("quick.toml: exclude[0] matches nothing",))

    def measured(self, outcomes: str, instant: str, plan: Plan) -> Document:
        """Return a shard that ran the first cell."""
        return shard(replace(planned_record(0, outcomes, measured=instant), cell=plan.cells[0]), plan=plan)

    def test_cells_speak_as_they_are_now(self) -> None:
        """Remarks on a replaced result are dropped; remarks of the matrix itself appear once."""
        plan = self.expecting()
        better = self.measured("pppp", "2026-11-20T12:00:00Z", plan)
        as_expected = self.measured("pppf", "2026-11-21T12:00:00Z", plan)

        assert len(better.stale) == 2
        assert merge(better, as_expected).stale == ("quick.toml: exclude[0] matches nothing",)

    def test_a_time_that_has_passed(self) -> None:
        """An expectation is out of date as of the newest report."""
        plan = self.expecting(until="2026-11-21T23:59:59Z")
        red = self.measured("pppf", "2026-11-21T12:00:00Z", plan)

        later = msgspec.structs.replace(shard(plan=plan), generated="2026-11-22T00:00:01Z")

        assert merge(red, later).stale[1] == (
            f"{PLAN.cells[0].id} was expected to be partial until 2026-11-21T23:59:59Z, which has passed"
        )


class TestBelongTogether:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (
                lambda cell: msgspec.structs.replace(cell, axes={**cell.axes, "python": "3.10"}),
                "1: made of another state of the matrix than 0: the axes of quick/py3.9_gymnasium-0.29.1_mujoco-2.3.7"
                " differ; measure again what was measured before, with one state of it",
            ),
            (
                lambda cell: msgspec.structs.replace(cell, requirements=("gymnasium==0.29",)),
                "1: made of another state of the matrix than 0: the requirements of"
                " quick/py3.9_gymnasium-0.29.1_mujoco-2.3.7 differ; measure again what was measured before, with one"
                " state of it",
            ),
            (
                lambda cell: msgspec.structs.replace(cell, cases=cell.cases[:1]),
                "1: made of another state of the matrix than 0: the cases of quick/py3.9_gymnasium-0.29.1_mujoco-2.3.7"
                " differ; measure again what was measured before, with one state of it",
            ),
        ],
    )
    def test_other_questions_are_refused(self, change: Callable[[CellEntry], CellEntry], message: str) -> None:
        """Answers to two questions are not put under one name; both files are named."""
        one = shard(planned_record(0))
        two = msgspec.structs.replace(one, cells=(change(one.cells[0]), *one.cells[1:]))

        with pytest.raises(BadInput) as caught:
            merge(one, two)

        assert str(caught.value) == message

    @pytest.mark.parametrize(
        "change",
        [
            lambda cell: replace(cell, question=replace(cell.question, constraints=("numpy<2",))),
            lambda cell: replace(cell, cases=(replace(cell.cases[0], kwargs={"frame_skip": 2}), *cell.cases[1:])),
            lambda cell: replace(cell, cases=(replace(cell.cases[0], steps=3), *cell.cases[1:])),
        ],
        ids=["constraints", "kwargs", "steps"],
    )
    def test_constraints_and_arguments_make_another_question(self, change: Callable[[Cell], Cell]) -> None:
        """Constraints and arguments make another question under the same id and requirements."""
        cells = [PLAN.cells[0], change(PLAN.cells[0])]
        one, other = (shard(record(of=cell), plan=replace(PLAN, cells=(cell,))) for cell in cells)

        with pytest.raises(BadInput, match=r"the packages and cases of \S+ differ;"):
            merge(one, other)

    def test_another_snapshot_is_refused(self) -> None:
        """A matrix as of another day is another one; instants that no matrix names may differ between shards."""
        days = [shard(plan=replace(PLAN, snapshot=day)) for day in ("2026-11-20T23:59:59Z", "2026-11-21T23:59:59Z")]
        asked = [replace(PLAN.cells[0], question=replace(PLAN.cells[0].question, snapshot=day)) for day in "ab"]

        with pytest.raises(BadInput, match=r"the snapshot of quick differ;"):
            merge(*days)
        assert merge(*(shard(plan=replace(PLAN, cells=(cell,))) for cell in asked)).cells[0].id == PLAN.cells[0].id

    def test_another_commit_of_the_subject_is_refused(self) -> None:
        """Shards of two commits of the package under test are no one answer."""
        cells = [replace(PLAN.cells[0], subject=Subject(source=".", commit=commit)) for commit in ("aaaa", "bbbb")]
        one, other = (shard(record(of=cell), plan=replace(PLAN, cells=(cell,))) for cell in cells)

        with pytest.raises(BadInput, match=r"the state of the subject of \S+ differ;"):
            merge(one, other)
        assert merge(one, one).cells[0].subject == one.cells[0].subject

    def test_other_probes_are_refused(self) -> None:
        """Results measured with different probes are not merged into one table."""
        one = msgspec.structs.replace(shard(planned_record(0)), probes={"gymnasium.single": "6ee7"})
        two = msgspec.structs.replace(shard(planned_record(1)), probes={"gymnasium.single": "4557"})

        with pytest.raises(BadInput) as caught:
            merge(one, two)

        assert str(caught.value) == (
            "1: made by another simmatrix than 0: the probes of gymnasium.single differ;"
            " measure again what was measured before, with one version of it"
        )


class TestPlaces:
    def placed(self, *contents: str) -> tuple[Document, dict[str, str]]:
        """Place the locks of the first cells, with these contents; return the document and the file names by token."""
        tokens = (merging.token("locks/5f0c.txt", content) for content in contents)
        return merging.assign_paths(shard(*(planned_record(number, lock=token) for number, token in enumerate(tokens))))

    def test_one_content_lies_there_once(self) -> None:
        """A lock that several cells have keeps its name."""
        made, names = self.placed("a" * 64, "a" * 64)

        assert names == {"locks/5f0c.txt\0" + "a" * 64: "locks/5f0c.txt", **self.logs(names)}
        assert {cell.lock for cell in made.cells} == {"locks/5f0c.txt", None}

    def test_two_contents_of_one_name_are_kept_apart(self) -> None:
        """Neither covers the other, and merging again gives the same names."""
        made, _ = self.placed("a" * 64, "b" * 64)

        assert {cell.lock for cell in made.cells if cell.lock} == {"locks/5f0c~aaaaaaaa.txt", "locks/5f0c~bbbbbbbb.txt"}
        assert merging.token("locks/5f0c~aaaaaaaa.txt", "a" * 64) == merging.token("locks/5f0c.txt", "a" * 64)
        assert merging.token("evidence/d2c9~aaaaaaaa", "a") == merging.token("evidence/d2c9", "a")

    def logs(self, names: dict[str, str]) -> dict[str, str]:
        """Return the names of files that are no locks."""
        return {token: name for token, name in names.items() if not name.startswith("locks")}

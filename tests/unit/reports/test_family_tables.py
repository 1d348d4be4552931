"""Tables of behaviour: ranges of releases, rows of environments, what the states exercise."""

from __future__ import annotations

import msgspec
from builders import case, cell, entry, record

from harness.model.report_types import BehaviourEntry, BoundaryEntry, CellEntry
from harness.reports.tables import family_tables
from harness.reports.text import family_markdown


def behaving(release: str, reference: str | None = None, *, axis: str = "mujoco", family: str = "A") -> CellEntry:
    """Return a cell with one case, stepped from a bank by this release."""
    of = cell(f"{axis}-{release}", ("ant",), axes={"python": "3.11", axis: release})
    made = entry(record(case("pppp", "ant"), of=of))
    classes = {"sum": "identical", "dynamics": "identical", "start": "identical"} if reference else {}
    behaviour = BehaviourEntry(
        bank="b", family=family, reference=reference, classes=classes, coverage={"contact": 0.5, "limit": 0.25}
    )
    (only,) = made.cases
    return msgspec.structs.replace(made, cases=(msgspec.structs.replace(only, behaviour=behaviour),))


def test_releases_that_behave_alike_share_a_column() -> None:
    """Releases stand in their order, 3.10 behind 3.9; what the states exercise is a table beside."""
    cells = [
        behaving("3.10.0", "quick/mujoco-3.9.0", family="B"),
        behaving("3.2.0"),
        behaving("3.9.0", "quick/mujoco-3.2.0"),
    ]
    (table,) = family_tables.tables(cells, ("python", "mujoco"))
    assert table.columns == ("3.2.0 to 3.9.0", "3.10.0")
    assert table.rows == (("Ant-v5", ("A", "B")),)
    assert (table.changed, table.tasks, table.measured, table.subject) == (1, 1, 3, "mujoco")
    assert [step and step.kind for step in table.steps["Ant-v5"]] == [None, "identical", "identical"]
    assert "| Ant-v5 | 50% | 25% | 0% |\n" in family_markdown.coverage_table(table)


def test_every_environment_has_a_row() -> None:
    """Versions of one that behave alike share it; environments without a version never do."""
    names = ("Ant-v4", "Ant-v5", "robosuite:Lift", "robosuite:Stack")

    def with_cases(release: str, reference: str | None) -> CellEntry:
        made = behaving(release, reference)
        (only,) = made.cases
        return msgspec.structs.replace(
            made, cases=tuple(msgspec.structs.replace(only, case=name, env=name) for name in names)
        )

    (table,) = family_tables.tables(
        [with_cases("3.2.0", None), with_cases("3.9.0", "quick/mujoco-3.2.0")], ("python", "mujoco")
    )
    assert [env for env, _ in table.rows] == ["Ant-v4, v5", "robosuite:Lift", "robosuite:Stack"]
    assert [env for env, _ in table.coverage] == ["Ant-v4, v5", "robosuite:Lift", "robosuite:Stack"]


def test_cases_that_share_an_environment_are_called_by_their_ids() -> None:
    """Meta-World's tasks are arguments of one environment: each case has a row and a line of its own."""

    def with_tasks(release: str, reference: str | None, families: str) -> CellEntry:
        made = behaving(release, reference)
        (only,) = made.cases
        cases = []
        for name, family in zip(("peg-v3", "reach-v3"), families, strict=True):
            assert only.behaviour
            behaviour = msgspec.structs.replace(only.behaviour, family=family)
            cases.append(msgspec.structs.replace(only, case=name, env="Meta-World/MT1", behaviour=behaviour))
        return msgspec.structs.replace(made, cases=tuple(cases))

    cells = [with_tasks("3.2.0", None, "AA"), with_tasks("3.9.0", "quick/mujoco-3.2.0", "BA")]
    boundary = BoundaryEntry(
        matrix="quick", case="peg-v3", env="Meta-World/MT1", axis="mujoco", before="3.2.0", after="3.9.0",
        cells=(cells[0].id, cells[1].id), kind="changed", start="identical", stage=None, output="state", largest=1.0,
        median=0.5, share=1.0, moved={}, between=(), text="behaves otherwise", changelog="",
    )  # fmt: skip
    called, boundaries = family_tables.call_by_ids(cells, [boundary])
    (table,) = family_tables.tables(called, ("python", "mujoco"), boundaries)
    assert table.rows == (("peg-v3", ("A", "B")), ("reach-v3", ("A", "A")))
    assert [change.lines for change in family_tables.changes(boundaries)] == [(("peg-v3", "behaves otherwise"),)]
    steps = table.steps["peg-v3"][1], table.steps["reach-v3"][1]
    assert [step and step.kind for step in steps] == ["changed", "identical"]


def test_an_axis_of_two_packages_is_called_after_both() -> None:
    """The values name them: `gym-0.26.2`, `gymnasium-1.0.0`; a boundary's title has no axis before it."""
    cells = [behaving("gymnasium-1.0.0", axis="release"), behaving("gym-0.26.2", axis="release")]
    (table,) = family_tables.tables(cells, ("python", "release"))
    assert (table.releases, table.subject) == (("gym-0.26.2", "gymnasium-1.0.0"), "gym and gymnasium")
    boundary = BoundaryEntry(
        matrix="quick", case="ant", env="Ant-v5", axis="release", before="gym-0.26.2", after="gymnasium-1.0.0",
        cells=("a", "b"), kind="changed", start="identical", stage=None, output="state", largest=1.0, median=0.5,
        share=1.0, moved={}, between=(), text="behaves otherwise", changelog="",
    )  # fmt: skip
    (change,) = family_tables.changes([boundary])
    assert change.title == "gym-0.26.2 to gymnasium-1.0.0"

"""The wide matrix as it is committed: how many cells, of which tasks, covering what."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

from harness.matrix import matrix_file, plan, version_ranges
from harness.matrix.matrix_types import Chosen, Expansion, Matrix
from harness.model import Plan

FOLDER = Path(__file__).parents[3] / "matrices"
TASKS = {
    *("Ant", "HalfCheetah", "Hopper", "Humanoid", "HumanoidStandup", "InvertedDoublePendulum", "InvertedPendulum"),
    *("Pusher", "Reacher", "Swimmer", "Walker2d"),
}
BASELINE = {"python": "3.11", "gymnasium": "1.2.3", "mujoco": "3.3.7"}


@pytest.fixture(scope="module")
def wide() -> tuple[Matrix, Expansion, Plan]:
    """Return the matrix, its expansion and its plan."""
    name = "gymnasium-mujoco"
    matrix = matrix_file.read((FOLDER / f"{name}.toml").read_text(encoding="utf-8"), f"{name}.toml")
    made = version_ranges.read((FOLDER / f"{name}.expanded.json").read_text(encoding="utf-8"), f"{name}.expanded.json")
    return matrix, made, plan.make_plan(plan.Sources(matrix=matrix, expansion=made, host_python="3.11.7"))


def test_its_size(wide: tuple[Matrix, Expansion, Plan]) -> None:
    """At most 120 cells, from the oldest to the newest of each axis; nothing in the file is without a use."""
    cells = wide[2].cells

    assert len(cells) <= 120
    assert wide[2].stale == ()
    values = {axis: {cell.axes[axis] for cell in cells} for axis in BASELINE}
    assert values["python"] == {"3.8", "3.9", "3.10", "3.11", "3.12", "3.13"}
    assert {"0.27.1", "1.4.0"} <= values["gymnasium"]
    assert {"2.3.3", "4.0.0"} <= values["mujoco"]


def test_every_task_in_every_cell_of_the_baseline(wide: tuple[Matrix, Expansion, Plan]) -> None:
    """All tasks that exist there are tried, those that a cell refuses by design apart."""
    around = [cell for cell in wide[2].cells if sum(cell.axes[axis] != value for axis, value in BASELINE.items()) <= 1]

    assert len(around) == (6 - 2) + (8 - 1) + (13 - 1)  # gymnasium 1.2 is not for Python 3.8 and 3.9
    for cell in around:
        new = not cell.axes["gymnasium"].startswith("0.")
        old = {f"{task}-v4" for task in TASKS}
        if new and not cell.axes["mujoco"].startswith("2."):
            old.remove("Pusher-v4")
        assert {case.env for case in cell.cases} == old | ({f"{task}-v5" for task in TASKS} if new else set())


def test_every_pair_that_resolves_is_measured(wide: tuple[Matrix, Expansion, Plan]) -> None:
    """A pair of versions is in a cell, or was found not to resolve."""
    matrix, made, planned = wide
    assert isinstance(made.chosen, Chosen)
    there = {pair for cell in planned.cells for pair in combinations(cell.axes.items(), 2)}
    impossible = [entry.axes for entry in made.chosen.unresolvable]
    values = {
        axis: [value.text for value in matrix.axes[axis].values] or list(made.axes.get(axis, ())) for axis in BASELINE
    }
    for one, other in combinations(values, 2):
        for pair in ((a, b) for a in values[one] for b in values[other]):
            told = any(entry.items() <= {one: pair[0], other: pair[1]}.items() for entry in impossible)
            assert told or ((one, pair[0]), (other, pair[1])) in there


def test_expectations_have_references(wide: tuple[Matrix, Expansion, Plan]) -> None:
    """Each says why, with a line or a known issue to match, and a link to where it was reported."""
    for expected in wide[0].expect:
        assert expected.link
        assert expected.link.startswith("https://github.com/")
        assert expected.match or expected.signature

"""Combinations of which only a table is left: every row becomes a measured cell that says no more than the table."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from harness.__main__ import main
from harness.model import Outcome, Phase, Verdict
from harness.model.measured import MeasuredCell
from harness.reports.answers import digest, result_index
from harness.reports.past_results import collection, table_files
from harness.standalone.failures.silent import plainly_good

ROOT = Path(__file__).parents[3]
HAND = """
[[combination]]
requirements = ["gymnasium[mujoco]==1.4.0", "mujoco==3.3.7", "imageio"]
python = "3.11"
snapshot = "2026-11-20T23:59:59Z"
installed = { numpy = "2.4.6" }
cases = [
    { env = "Ant-v5", api = "gymnasium", first_failure = "none" },
    { env = "dm_control:cheetah/run", api = "dm_control", first_failure = "FAILURE", decisive = "no wings" },
]
"""


def tables(folder: Path, failure: str) -> MeasuredCell:
    """Return the cell of a table with one row, whose second case fails first in this phase."""
    file = folder / table_files.HAND
    file.parent.mkdir(parents=True)
    # What cannot be installed fails for all cases alike.
    none = failure if failure in {"resolve", "install"} else "none"
    file.write_text(HAND.replace('"none"', f'"{none}"').replace("FAILURE", failure))
    (cell,) = collection.from_tables(folder).cells
    return cell


def shipped() -> dict[str, MeasuredCell]:
    """Return the cells of this checkout's tables by their ids."""
    return {cell.id: cell for cell in collection.from_tables(ROOT).cells}


def read(name: str) -> dict[str, Any]:
    """Return a table of this checkout."""
    return tomllib.loads((ROOT / name).read_text())


# --- the tables that come with us ------------------------------------------------------------------------------


def test_every_row_is_a_cell() -> None:
    """As many cells as rows, with as many cases, in the results that ship; each says where it comes from."""
    hand, truth = read(table_files.HAND)["combination"], read(table_files.TRUTH)["truth"]
    cells = [cell for cell in result_index.load_shipped().cells if cell.source]

    by_source = {
        name: [cell for cell in cells if cell.source == name] for name in (table_files.HAND, table_files.TRUTH)
    }
    assert {name: len(found) for name, found in by_source.items()} == {
        table_files.HAND: len(hand),
        table_files.TRUTH: len(truth),
    }
    assert len(cells) == len({cell.id for cell in cells}) == len(hand) + len(truth) > 200
    assert sum(len(cell.cases) for cell in by_source[table_files.HAND]) == sum(len(entry["cases"]) for entry in hand)
    assert {cell.id for cell in by_source[table_files.TRUTH]} == {f"judged/{entry['cell']}" for entry in truth}


def test_a_cell_says_what_its_row_says() -> None:
    """The first failing phase, the line, the versions as typed and installed, the day; nothing that is not there."""
    cells = shipped()
    judged = read(table_files.JUDGED)["axes"]["what"]
    for entry in read(table_files.TRUTH)["truth"]:
        cell = cells[f"judged/{entry['cell']}"]
        assert (cell.phase, cell.decisive, cell.lock, cell.first_failure_only) == (
            entry["phase"],
            entry["line"],
            None,
            True,
        )
        assert cell.causes == tuple(entry["named"][:1])
        assert list(cell.requirements) == judged[entry["cell"].partition("_")[2]]["requirements"]
        assert cell.measured.startswith("2026-11-22")
    ends = {"none": None}
    rows = read(table_files.HAND)["combination"]
    for entry, cell in zip(rows, (one for one in cells.values() if one.source == table_files.HAND), strict=True):
        failures = [ends.get(case["first_failure"], case["first_failure"]) for case in entry["cases"]]
        assert [first_failure(case.phases, cell) for case in cell.cases] == failures
        assert cell.installed is None or cell.installed | entry.get("installed", {}) == cell.installed
        assert list(cell.requirements) == entry["requirements"]
        assert (cell.verdict is Verdict.WORKS) == (set(failures) == {None})


def first_failure(phases: dict[Phase, Outcome], cell: MeasuredCell) -> str | None:
    """Return the first phase of a case, or of its cell, that failed."""
    return (
        next((phase for phase, how in (cell.phases | phases).items() if how is Outcome.FAILED), None)
        if (Outcome.FAILED in phases.values() or cell.verdict in {Verdict.UNRESOLVABLE, Verdict.UNINSTALLABLE})
        else None
    )


def test_the_line_of_a_case_is_the_text_inside_its_code_span() -> None:
    """The page of agreement shows lines as code; known failures are found in them all the same."""
    cell = shipped()["measured-by-hand/py3.12_gymnasium-1.4.0_imageio_mujoco-4.0.0"]

    assert [case.decisive for case in cell.cases] == ["ModuleNotFoundError: No module named 'packaging'"] * 3
    assert cell.causes == ("gymnasium-packaging-missing",)
    assert not any((case.decisive or "").startswith("`") for each in shipped().values() for case in each.cases)


def test_a_silent_issue_is_not_excluded() -> None:
    """By hand only exceptions were seen: where a silent issue fits, a cell is not plainly good."""
    cell = shipped()["measured-by-hand/py3.11_gymnasium.mujoco-1.4.0_mujoco-2.3.7"]

    assert (cell.verdict, cell.unverified) == (Verdict.WORKS, ("silent:mujoco-before-numpy2-vectors",))
    assert not plainly_good(cell.verdict, cell.unverified)


def test_combinations_without_a_result_are_left_out() -> None:
    """Nobody wrote down how twelve of the judged combinations ended: nothing is claimed of them."""
    judged = read(table_files.JUDGED)["axes"]["what"]
    names = {name.partition("_")[2] for name in shipped() if name.startswith("judged/")}

    assert len({*judged} - names) == 12
    assert not [cell.id for cell in shipped().values() if cell.matrix == "judged" and cell.verdict is Verdict.WORKS]


# --- one row ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failure", "verdict", "phases"),
    [
        ("resolve", "unresolvable", {}),
        ("install", "uninstallable", {}),
        ("import", "partial", {"import": "failed", "single": "not_reached", "render": "not_reached"}),
        ("single", "partial", {"import": "passed", "single": "failed", "render": "not_reached"}),
        ("render", "partial", {"import": "passed", "single": "passed", "render": "failed"}),
        ("none", "works", {"import": "passed", "single": "passed", "render": "passed"}),
    ],
)
def test_phases_are_known_up_to_the_first_failure(
    tmp_path: Path, failure: str, verdict: str, phases: dict[str, str]
) -> None:
    """Later phases were not reached; of an API without batches `vector` is not claimed."""
    cell = tables(tmp_path, failure)

    assert cell.verdict == verdict
    assert cell.first_failure_only == (failure != "none")
    if phases:
        second = {str(phase): str(how) for phase, how in cell.cases[1].phases.items()}
        second.pop("vector", None) if failure in {"import", "single"} else None
        assert second == phases
        assert cell.cases[0].phases == dict.fromkeys(("import", "single", "vector", "render"), "passed")
        assert cell.installed == {"gymnasium": "1.4.0", "mujoco": "3.3.7", "numpy": "2.4.6"}
    else:
        assert cell.installed is None
        assert {*cell.cases[0].phases.values()} == {Outcome.NOT_REACHED}


def test_without_tables_there_is_nothing(tmp_path: Path) -> None:
    """A wheel has no tables beside it: its document holds their cells already."""
    assert collection.from_tables(tmp_path).cells == ()
    assert table_files.list_files(tmp_path) == []


def test_a_document_keeps_the_cells(tmp_path: Path) -> None:
    """Put with other results they stay the same, remedies of their causes among them."""
    found = collection.from_tables(ROOT)

    kept = digest.combine([found])
    assert {cell.id: cell for cell in kept.cells} == {cell.id: cell for cell in found.cells}
    assert kept.remedies == found.remedies
    assert found.remedies["pymunk7-collision-handler"] == "pin `pymunk<7`"


# --- opened ----------------------------------------------------------------------------------------------------


def test_a_cell_of_a_table_opens(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`show` says what its table says, where that lies, and how to measure it anew."""
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    assert main(["show", "judged/py3.10_gym-pusht"]) == 0

    said = capsys.readouterr().out
    assert said.startswith("judged/py3.10_gym-pusht\n✘ broken in single\n  has no attribute 'add_collision_handler'\n")
    assert "\ntable      benchmarks/judged-truth.toml: its lock and evidence were not kept, and " in said
    assert "\nknown as   pymunk7-collision-handler: simmatrix known pymunk7-collision-handler\n" in said
    assert said.endswith("next\n  simmatrix try gym-pusht==0.1.5 --python 3.10 --env gym_pusht/PushT-v0\n")

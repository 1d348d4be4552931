"""Remedies of real failures, found by experiment alone and proven, with packages from the real index.

Those of `LONG` are looked for where `ENDURANCE` is set.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from harness.__main__ import main
from harness.commands.repair import MINUTES, RUNS, repair
from harness.machine import interpreters, store
from harness.model import Cell
from harness.rootcause.bench import Bounds
from harness.rootcause.repair.proofs import RepairDocument
from harness.rootcause.repair.repairing import Status
from harness.running import open_matrix, scheduler

MATRIX = Path(__file__).parents[2] / "matrices" / "breakages.toml"
LONG = pytest.mark.skipif("ENDURANCE" not in os.environ, reason="unavailable: ENDURANCE=1, in which it is looked for")


class Silent:
    """A listener that prints nothing."""

    def started(self, cell: Cell) -> None:
        """Print nothing."""

    def step(self, cell: Cell, text: str) -> None:
        """Print nothing."""

    def done(self, record: object) -> None:
        """Print nothing."""

    def say(self, text: str) -> None:
        """Print nothing."""


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use an empty state, and no known failures; the user's own index settings and caches stay."""
    monkeypatch.setenv("HARNESS_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("HARNESS_SIGNATURES", "")


@pytest.fixture(scope="module")
def cells() -> dict[str, Cell]:
    """Return the cells of the matrix by their labels."""
    return {cell.label: cell for cell in open_matrix.load(str(MATRIX), print).cells}


def repaired(cell: Cell) -> RepairDocument:
    """Repair a cell and return the document; skip the test if this machine cannot measure the cell."""
    if interpreters.find(cell.python) is None:
        pytest.skip(f"unavailable: python{cell.python}")
    bounds = Bounds(runs=RUNS, minutes=MINUTES)
    made, _ = repair(cell, store.open_store(), scheduler.Settings(), bounds, Silent(), command="-")
    if made.status is Status.UNTOLD:
        pytest.skip("unavailable: package index")
    return made


@pytest.mark.parametrize(
    ("label", "change"),
    [
        pytest.param("py3.10_gym0.26-numpy", {"constraints": ["numpy<2"]}, id="numpy 2 beside gym 0.26"),
        pytest.param(
            "py3.11_gymnasium1.4-packaging",
            {"requirements": ["imageio", "packaging"]},
            id="two packages that only an extra names",
        ),
        pytest.param(
            "py3.10_gym0.25-numpy", {"constraints": ["numpy<1.24"]}, id="two things that numpy took", marks=LONG
        ),
        pytest.param("py3.12_mujoco2.3-sdist", {"python": "3.11"}, id="no wheel, and no MUJOCO_PATH", marks=LONG),
        pytest.param(
            "py3.11_human-mujoco3", {"requirements": ["mujoco==2.3.7"]}, id="a window beside MuJoCo 3", marks=LONG
        ),
    ],
)
def test_remedy_is_found_and_proven(cells: dict[str, Cell], label: str, change: dict[str, Any]) -> None:
    """A remedy is found without known failures; each part is needed, and the whole passes every check."""
    made = repaired(cells[label])
    assert made.remedy is not None, (made.status, made.decisive)
    assert (made.status, made.remedy.change) == (Status.FOUND, change)
    assert made.remedy.necessary
    assert made.remedy.sufficient


@pytest.mark.parametrize(
    ("asked", "change", "runs"),
    [
        pytest.param(
            ("stable-baselines3==2.3.2", "gymnasium==1.0.0", "--python", "3.11"),
            {"requirements": ["gymnasium>=0.28.1,<0.30"]},
            2,
            id="two that the resolver keeps apart",
            marks=LONG,
        ),
        pytest.param(
            ("dm-control==1.0.31", "mujoco==3.3.2", "--python", "3.11", "--env", "dm_control:cartpole/swingup"),
            {"requirements": ["mujoco==3.3.3"]},
            2,
            id="the nearest release that the resolver names",
        ),
        pytest.param(
            ("robosuite==1.4.1", "--python", "3.9", "--env", "robosuite:Lift"),
            {"only_binary": ["mujoco"]},
            4,
            id="a known failure of a package that nobody asked for",
            marks=LONG,
        ),
        pytest.param(
            (
                "gymnasium-robotics==1.4.2",
                "--python",
                "3.11",
                "--env",
                "FetchReach-v4",
                "--import",
                "gymnasium_robotics",
            ),
            {"requirements": ["mujoco<3.12"]},
            9,
            id="the widest bound",
            marks=LONG,
        ),
    ],
)
def test_remedies_of_typed_requirements_are_found(
    asked: tuple[str, ...],
    change: dict[str, Any],
    runs: int,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A remedy is found within few runs with all known failures; one named by the error is tried first."""
    monkeypatch.delenv("HARNESS_SIGNATURES")
    if interpreters.find(asked[asked.index("--python") + 1]) is None:
        pytest.skip("unavailable: its Python")
    code = main(["repair", *asked, "--as-of", "2026-11-20", "--json"])
    made = json.loads(capsys.readouterr().out)
    if code == 3:
        pytest.skip("unavailable: package index")
    assert (code, made["remedy"]["change"]) == (0, change)
    assert len(made["runs"]) <= runs
    assert made["remedy"]["necessary"]
    assert made["remedy"]["sufficient"]

"""Policies of cases: the files that hold them, and what the phase `behave` runs of a case."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import builders
import pytest

from harness.matrix import policies
from harness.model.hostile_data import Unreadable

FILES = sorted((Path(__file__).parents[3] / "matrices" / "policies").glob("*.json"))
MATRIX = """
axes = { python = ["3.11"], gymnasium = ["1.0.0"] }

[[cases]]
env = "Hopper-v5"
api = "gymnasium"
checks = ["import", "behave"]
"""
POLICY = {"by": "linear", "gain": 100.0, "mean": (0.0,), "deviation": (1.0,), "weights": ((1.0,),)}
STEP, PLAY = "behave.steps", "behave.policy"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_committed_policy_can_be_read(path: Path) -> None:
    """It is better than random actions, and its file is named like its environment and says how it was made."""
    content = path.read_bytes()
    policy = policies.read(content)
    assert policy["gain"] > 50
    assert json.loads(content)["env"].lower() == path.stem
    assert json.loads(content)["origin"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weights": [[1.0]]}, "have to have one length"),
        ({"deviation": [1.0, 0.0]}, "Expected `float` > 0.0"),
        ({"scale": {"random": 5.0, "policy": 4.0}}, "its return is not above that of random actions"),
        ({"form": 3}, "Invalid enum value 3"),
        ({"colour": "red"}, "unknown field `colour`"),
    ],
)
def test_a_wrong_file_is_refused(change: dict[str, Any], message: str) -> None:
    """The reason names what is wrong."""
    right = {
        "form": 1,
        "env": "Hopper-v5",
        "origin": {},
        "scale": {"random": 0.0, "policy": 9.0},
        "mean": [0.0, 0.0],
        "deviation": [1.0, 1.0],
        "weights": [[1.0, 2.0]],
    }
    assert policies.read(json.dumps(right).encode())["gain"] == 9.0
    with pytest.raises(Unreadable, match=message):
        policies.read(json.dumps({**right, **change}).encode())
    with pytest.raises(Unreadable):
        policies.read(json.dumps(right).encode()[:-5])


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ("", [STEP]),
        ('bank = "hopper.npz"', [STEP]),
        ('policy = "hopper.json"', [PLAY]),
        ('policy = "metaworld"', [PLAY]),
        ('policy = "hopper.json"\nbank = "hopper.npz"', [STEP, PLAY]),
    ],
)
def test_a_case_runs_what_it_brings_something_for(keys: str, wanted: list[str]) -> None:
    """A policy is played where there is one, and states are stepped where there is a bank, or neither."""
    planned = builders.make_plan(
        MATRIX + keys, banks={"hopper.npz": ("0" * 64, "/x")}, policies={"hopper.json": POLICY}
    )
    (case,) = planned.cells[0].cases
    assert [check for check in case.checks if check.startswith("behave.")] == wanted


def test_a_case_holds_the_policy_with_its_episodes() -> None:
    """200 are played unless the case says otherwise; the scripted policy needs no file."""
    policy = (
        builders.make_plan(MATRIX + 'policy = "hopper.json"', policies={"hopper.json": POLICY}).cells[0].cases[0].policy
    )
    assert policy == {**POLICY, "episodes": 200}
    text = MATRIX + 'policy = "metaworld"\nepisodes = 9'
    assert builders.make_plan(text).cells[0].cases[0].policy == {"by": "metaworld", "episodes": 9}
    assert builders.make_plan(MATRIX).cells[0].cases[0].policy is None

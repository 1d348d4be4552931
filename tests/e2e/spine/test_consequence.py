"""The effect of a change on a policy: every cell plays the same seeds, a report and `compare` say the effect."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commandline import Desk

MATRIX = """
axes = { python = ["host"], fake-hover = ["1.0", "1.1", "2.0"] }
requirements = ["gymnasium"]
index = { no_index = true, find_links = ["@WHEELS@"] }

[[cases]]
id = "hover"
env = "fake_hover:Hover-v0"
api = "gymnasium"
checks = ["import", "single.loop", "behave"]
policy = "hover.json"
episodes = 100
"""
POLICY = {
    "form": 1,
    "env": "fake_hover:Hover-v0",
    "origin": {"by": "hand: it pushes as much as gravity pulls, and more where it is low or falls"},
    "scale": {"random": -900.0, "policy": -3.0},
    "mean": [0.41, 0.0],
    "deviation": [1.0, 1.0],
    "weights": [[-2.0, -1.0]],
}


@pytest.fixture
def hovering(desk: Desk) -> Desk:
    """Return a desk with the matrix and the policy."""
    (desk.folder / "hover.json").write_text(json.dumps(POLICY))
    desk.matrix("hover", MATRIX)
    return desk


def test_a_report_says_where_a_policy_does_worse(hovering: Desk) -> None:
    """Another order of sums is equal, more gravity worse; judged again from its evidence the report is the same."""
    ran = hovering.run("run", "hover.toml", "--out", "out", "--json")
    assert ran.code == 0, ran.err
    equal, worse = ran.document["consequences"]
    assert (equal["before"], equal["after"], equal["effect"]) == ("1.0", "1.1", "equal within 5 points")
    assert (equal["values"], equal["difference"], equal["moved_starts"]) == ([1.0, 1.0], 0.0, 0)
    assert -5 < equal["interval"][0] < 0 < equal["interval"][1] < 5
    assert (worse["effect"], worse["values"], worse["difference"]) == ("worse", [1.0, 0.0], -100.0)
    assert (worse["measure"], worse["episodes"], list(worse["moved"])) == ("success", 100, ["fake-hover"])
    page = (hovering.folder / "out" / "report.md").read_text(encoding="utf-8")
    line = "hover, fake-hover 1.1 to 2.0: worse: 100.0 % of 100 episodes succeed before, 0.0 % after (-100.0 points, "
    assert line in page
    before = {path.name: path.read_bytes() for path in Path(hovering.folder / "out").glob("report.*")}
    again = hovering.run("report", "--judge-again", "--write", "out")
    assert again.code == 0, again.err
    assert {path.name: path.read_bytes() for path in Path(hovering.folder / "out").glob("report.*")} == before


def test_compare_says_what_a_change_does_to_the_policy(hovering: Desk) -> None:
    """The effect follows the sentence of the difference, also in the document."""
    cells = [f"hover.toml/py*_fake-hover-{version}" for version in ("1.0", "2.0")]
    ran = hovering.run("compare", *cells, "--json")
    assert ran.code == 1, ran.err
    (entry,) = ran.document["environments"]
    assert entry["consequence"].startswith("hover, by a policy: worse: 100.0 % of 100 episodes succeed before, 0.0 %")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"weights": [[1.0, 2.0, 3.0]]}, "have to have one length"),
        ({"scale": {"random": 1.0, "policy": 1.0}}, "its return is not above that of random actions"),
        ({"form": 2}, "Invalid enum value 2"),
    ],
)
def test_a_wrong_policy_is_refused_in_a_sentence(hovering: Desk, change: dict[str, object], said: str) -> None:
    """The message names the key of the matrix, the file, what is wrong with it, and what to do."""
    (hovering.folder / "hover.json").write_text(json.dumps({**POLICY, **change}))
    ran = hovering.run("run", "hover.toml")
    assert ran.code == 2
    assert "cases[0].policy: " in ran.err
    assert said in ran.err
    assert ran.err.strip().endswith("make one with `python -m benchmarks.linear_policy ENV --out FILE`")


def test_a_policy_of_another_size_is_not_played(hovering: Desk) -> None:
    """The check is skipped with both sizes; no effect is claimed."""
    wider = {"mean": [0.0] * 3, "deviation": [1.0] * 3, "weights": [[0.0] * 3]}
    (hovering.folder / "hover.json").write_text(json.dumps({**POLICY, **wider}))
    ran = hovering.run("run", "hover.toml", "--json", "--out", "out")
    case = ran.cells("fake-hover")["1.0"]["cases"][0]
    assert case["checks"]["behave.policy"] == "skipped"
    assert case["reasons"]["behave.policy"] == "its observations have 2 numbers, and the policy takes 3"
    assert "consequences" not in ran.document

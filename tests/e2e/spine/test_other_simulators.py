"""Behaviour of simulators other than MuJoCo's bindings: their states are set, and lead to the same each time."""

from __future__ import annotations

import json

import numpy as np
import pytest
from commandline import Desk

HEAD = """
requirements = ["{requires}"]
index = {{ no_index = true, find_links = ["@WHEELS@"] }}
axes = {{ python = ["host"], {name} = [{versions}] }}

[[cases]]
env = "{env}"
api = "{api}"
checks = ["import", "single.loop"]
"""
BULLET = HEAD.format(
    requires="gymnasium",
    name="fake-bullet",
    versions='"1.0", "2.0", "3.0", "4.0"',
    env="fake_bullet:Slide-v0",
    api="gymnasium",
)
BRAX = HEAD.format(requires="numpy", name="brax", versions='"0.1", "0.2", "0.3"', env="brax:slider", api="brax")


def freeze(desk: Desk, text: str, cell: str) -> dict[str, object]:
    """Freeze a cell to `frozen.npz`, and return the facts in it."""
    desk.matrix("other", text)
    ran = desk.run("freeze", f"other.toml/py*_{cell}", "--out", "frozen.npz")
    assert ran.code == 0, ran.err
    with np.load(desk.folder / "frozen.npz") as arrays:
        assert {*arrays["kind"].tolist()} == {0, 1, 2, 3}
        return dict(json.loads(arrays["facts"].tobytes()))


def check(desk: Desk, cell: str) -> tuple[int, str]:
    """Check a cell against `frozen.npz`."""
    ran = desk.run("freeze", f"other.toml/py*_{cell}", "--check", "frozen.npz")
    return ran.code, ran.out.strip() or ran.err


def test_bullet_forgets_contacts_before_a_state_is_set(desk: Desk) -> None:
    """Contacts of the steps before do not reach the next state; more gravity does."""
    facts = freeze(desk, BULLET, "fake-bullet-1.0")
    assert (facts["method"], facts["repeats"]) == ("state", True)
    assert facts["sizes"] == {"joint": 1, "joint_velocity": 1}
    assert "contact caches" in str(facts["unset"])
    assert check(desk, "fake-bullet-1.0") == (0, "fake_bullet:Slide-v0: behaves identically, to the bit")
    code, text = check(desk, "fake-bullet-2.0")
    assert code == 1
    assert text.startswith("fake_bullet:Slide-v0: behaves otherwise; the next state of the environment differs in ")


def test_states_of_every_kind_are_repeated(desk: Desk) -> None:
    """A simulator that repeats itself but for deep overlaps, which play never comes through, is found out."""
    assert freeze(desk, BULLET, "fake-bullet-3.0")["repeats"] is False
    code, text = check(desk, "fake-bullet-3.0")
    assert (code, "does not repeat itself from the same state" in text) == (3, True)


def test_a_copy_that_moves_otherwise_is_found_out(desk: Desk) -> None:
    """An environment that repeats itself while its next copy moves otherwise does not count as one that repeats."""
    assert freeze(desk, BULLET, "fake-bullet-4.0")["unrepeated"] == ["observation", "reward", "state"]


@pytest.mark.parametrize(
    ("version", "code", "said"),
    [
        ("0.1", 0, "behaves identically, to the bit"),
        ("0.2", 0, "behaves the same, up to rounding"),
        ("0.3", 1, "behaves otherwise; the next state of the environment differs in "),
    ],
)
def test_a_pure_function_is_measured_in_ulps_of_float32(desk: Desk, version: str, code: int, said: str) -> None:
    """Sums in another order are rounding in float32; 1 % of gravity is not."""
    facts = freeze(desk, BRAX, "brax-0.1")
    assert (facts["precision"], facts["repeats"], facts["parts"]) == ("float32", True, ["q", "qd"])
    got, text = check(desk, f"brax-{version}")
    assert (got, text[: len("brax:slider: ") + len(said)]) == (code, f"brax:slider: {said}")

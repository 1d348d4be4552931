"""A cell records pictures in numbers and values of a trajectory for later judging; the host believes sound ones."""

from __future__ import annotations

import hashlib
import math
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from harness.judging.runs.check import Ending, check_record
from harness.model import CheckReply, Outcome
from harness.probes.facts import drop_mistyped, plain

frames = import_module("harness.incell.cell_pictures")
trace = import_module("harness.incell.cell_trace")

BLACK = np.zeros((6, 9, 3), np.uint8)


def scene() -> Any:
    """Return a picture: a red object at the top left on grey ground."""
    picture = np.full((6, 9, 3), 100, np.uint8)
    picture[:2, :3] = (255, 10, 0)
    return picture


def test_a_picture_in_numbers() -> None:
    """Size, digest of the pixels, colours by four levels, nine mean colours, spread."""
    told = frames.picture_facts(scene())
    assert told == {
        "shape": [6, 9, 3],
        "sha256": hashlib.sha256(scene().tobytes()).hexdigest(),
        "constant": False,
        "colours": {"111": 48, "300": 6},
        "means": [[255.0, 10.0, 0.0], *[[100.0] * 3] * 8],
        "spread": [round(float(value), 3) for value in scene().std(axis=(0, 1))],
    }


@pytest.mark.parametrize(
    ("picture", "names"),
    [
        (scene()[::-1], {"sha256", "means"}),
        (scene()[:, ::-1], {"sha256", "means"}),
        (scene()[:, :, ::-1], {"sha256", "means", "colours", "spread"}),
        (scene() // 4 + 180, {"sha256", "means", "colours", "spread"}),
        (BLACK, {"sha256", "means", "colours", "spread", "constant"}),
    ],
    ids=["upside down", "mirrored", "red as blue", "washed out", "black"],
)
def test_a_wrong_picture_has_other_numbers(picture: Any, names: set[str]) -> None:
    """Each way of being wrong shows in its own places, without the picture."""
    right, wrong = frames.picture_facts(scene()), frames.picture_facts(picture)
    assert {name for name in right if right[name] != wrong[name]} == names


def test_a_tiny_picture() -> None:
    """Fields of the grid that are empty have no mean colour."""
    assert frames.picture_facts(BLACK[:1, :1])["means"] == [[0.0] * 3, *[None] * 8]


def test_values_of_a_trajectory() -> None:
    """Each entry's parts as numbers: of float32 the shortest; flags are 0 or 1."""
    made = trace.Trace()
    made.add(np.array([0.1, -2.5], np.float32))
    made.add({"b": np.array([3], np.int8), "a": np.array([1 / 3])}, 1.5, np.bool_(1), False)
    assert made.values() == {
        "steps": 2,
        "sizes": [2, 1, 1, 1],
        "entries": [[[0.1, -2.5]], [[1 / 3, 3], [1.5], [1], [0]]],
    }


def test_values_without_a_number() -> None:
    """A text is no numbers, and what is not finite is no number."""
    made = trace.Trace()
    made.add(("a word", 1), math.inf, False, False)
    assert made.values()["entries"] == [[None, [None], [0], [0]]]


@pytest.mark.parametrize(("width", "entries", "kept"), [(3, 400, 250), (200, 100, 14), (1000, 1, 1)])
def test_values_are_bounded(width: int, entries: int, kept: int) -> None:
    """At most 64 numbers of a part, and 1000 of all; what was cut can be told."""
    made = trace.Trace()
    made.add(np.zeros(width))
    for _ in range(entries - 1):
        made.add(np.zeros(width), *([0.0, False, False] if width > 3 else [0.0]))
    values = made.values()
    assert (values["steps"], values["sizes"][0], len(values["entries"])) == (entries, width, kept)
    assert max(len(part) for entry in values["entries"] for part in entry) == min(width, 64)
    assert drop_mistyped({"values": values}) == ({"values": values}, None)


CAMERA = {"position": [0, 1, 2], "forward": [0.0, 1.0, 0.0], "up": [0.0, 0.0, 1.0], "fovy": 45.0}
PICTURE = {**frames.picture_facts(scene()), "camera": CAMERA}
VALUES = {"steps": 9, "sizes": [4, 1, 1, 1], "entries": [[[0.5, 1]], [[0.5, None], [1.0], [0], [0]], [None]]}


@pytest.mark.parametrize(
    "facts",
    [
        {"pictures": {"first": PICTURE, "last": {**PICTURE, "camera": None}}, "gl": {}},
        {"pictures": {"first": {**PICTURE, "camera": {"view": [0.0] * 16, "lens": [1.0] * 16}}}},
        {"values": VALUES, "trajectory": ["ab"]},
        {"seconds": {}},
    ],
)
def test_honest_facts_are_believed(facts: dict[str, Any]) -> None:
    """They stay as they are, beside all other facts."""
    assert drop_mistyped(facts) == (facts, None)


@pytest.mark.parametrize(
    ("name", "fact", "why"),
    [
        ("pictures", [PICTURE], "Expected `object`, got `array`"),
        ("pictures", dict.fromkeys("abc", PICTURE), "Expected `object` of length <= 2"),
        ("pictures", {"first": {**PICTURE, "sha256": "ab"}}, "Expected `str` matching regex '^[0-9a-f]{64}$'"),
        ("pictures", {"first": {**PICTURE, "colours": {"400": 1}}}, "Expected `str` matching regex '^[0-3]{3}$'"),
        ("pictures", {"first": {**PICTURE, "means": []}}, "Expected `array` of length >= 9"),
        ("pictures", {"first": {**PICTURE, "spread": ["nan", 0.0, 0.0]}}, "Expected `float`, got `str`"),
        ("pictures", {"first": {**PICTURE, "more": 1}}, "Object contains unknown field `more`"),
        ("pictures", {"first": {**PICTURE, "camera": {"view": [0.0]}}}, "Expected `array` of length >= 16"),
        ("values", {**VALUES, "steps": -1}, "Expected `int` >= 0"),
        ("values", {**VALUES, "entries": [[]]}, "Expected `array` of length >= 1"),
        ("values", {**VALUES, "entries": [[[0.0] * 65]]}, "Expected `array` of length <= 64"),
        ("values", {**VALUES, "entries": [[[0.0] * 51]] * 20}, "more than 1000 numbers"),
    ],
)
def test_a_fact_that_cannot_be_believed_is_left_out(name: str, fact: Any, why: str) -> None:
    """The check and its other facts stay, and the problem is named."""
    kept, refusal = drop_mistyped({name: fact, "gl": {"modules": ["mujoco"]}})
    assert kept == {"gl": {"modules": ["mujoco"]}}
    assert refusal is not None
    assert refusal.startswith(f"its fact {name} is left out: {why}")


def test_records_leave_them_out() -> None:
    """They stay in the reply; records and documents are as they were."""
    facts = {"pictures": {"first": PICTURE}, "values": VALUES, "trajectory": ["ab"]}
    reply = CheckReply(check="single.loop", outcome=Outcome.PASSED, facts=facts)
    assert check_record(reply, Ending(), {}).facts == {"trajectory": ["ab"]} == plain(facts)

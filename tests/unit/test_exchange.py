"""Test how values pass between an environment and the library that drives it, and how calls are counted; no torch."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

exchange = import_module("harness.incell.cell_step_recorder")
counting = import_module("harness.incell.cell_copy_counts")

WORLDS = 3


class Batch:
    """Three worlds that end after 2, 3 and 4 steps and begin anew by themselves; all it gives can be one memory."""

    def __init__(self, *, reuse: bool = False) -> None:
        self.reuse = reuse
        self.age = np.zeros(WORLDS)
        self.given = np.zeros((WORLDS, 1))

    def reset(self, **_: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin anew everywhere."""
        self.age[:] = 0
        return {"policy": self.seen()}, {}

    def step(self, action: Any) -> tuple[Any, ...]:
        """Step all worlds once."""
        self.age += 1
        ended = self.age >= np.array([2, 3, 4])
        self.age[ended] = 0
        return {"policy": self.seen()}, self.age.copy(), ended, np.zeros(WORLDS, bool), {}

    def seen(self) -> Any:
        """Return the ages, in the same memory as before or in a copy."""
        if not self.reuse:
            return self.age[:, None].copy()
        self.given[:, 0] = self.age
        return self.given


def watched(env: Batch, steps: int) -> Any:
    """Return the exchange observed over a reset and some steps."""
    with exchange.StepRecorder(env) as seen:
        env.reset()
        for _ in range(steps):
            env.step(None)
    return seen


@pytest.mark.parametrize("reuse", [False, True])
def test_memory_that_is_reused_is_seen_and_values_are_kept(reuse: bool) -> None:
    """Of one that reuses its memory the parts of all steps hold the last values; the copies hold each step's."""
    seen = watched(Batch(reuse=reuse), 2)
    first, last = seen.steps
    assert exchange.reuses_memory(seen.steps) is reuse
    assert exchange.same_values(first.parts["policy"], first.copies["policy"]) is not reuse
    assert (first.copies["policy"][:, 0].tolist(), last.copies["policy"][:, 0].tolist()) == ([1, 1, 1], [0, 2, 2])
    assert [last.ended.tolist(), exchange.rows(last.copies["policy"], ~last.ended).tolist()] == [
        [True, False, False],
        [[2], [2]],
    ]


def test_an_environment_is_left_as_it_was() -> None:
    """Its own methods are back, also after an exception."""
    env = Batch()
    with pytest.raises(TypeError, match="unexpected keyword"), exchange.StepRecorder(env):
        env.step(None, wrong=True)  # type: ignore[call-arg]
    assert {"step", "reset"} & set(vars(env)) == set()


def test_worlds_amid_an_episode_are_counted_at_a_reset() -> None:
    """At the beginning none, later those that had not ended, unless a mask spares them."""
    env = Batch()
    with exchange.StepRecorder(env) as seen:
        env.reset()
        env.step(None)
        env.step(None)
        env.reset()
        env.step(None)
        env.reset(options={"reset_mask": np.array([True, False, False])})
    assert seen.resets == [0, 2, 0]


def test_values_are_compared_whatever_their_last_dimension() -> None:
    """A dimension of one more is no difference, another value is; no number equals itself."""
    assert exchange.same_values(np.array([1.0, np.nan]), np.array([[1.0], [np.nan]]))
    assert not exchange.same_values(np.array([1.0, 2.0]), np.array([[1.0], [3.0]]))
    assert not exchange.same_values(np.zeros(2), np.zeros(3))


def test_an_array_is_shown_in_one_line() -> None:
    """Type, dtype, shape and place; of anything else the type."""
    assert exchange.describe_array(np.zeros((2, 3), "float32")) == "numpy.ndarray float32 [2, 3] cpu"
    assert (exchange.describe_array(1.5), exchange.same_memory(1.5, np.zeros(1))) == ("float", None)


def test_a_conversion_is_counted_once_and_for_its_place() -> None:
    """A conversion that another one calls is not counted again; outside of any place nothing is counted."""
    counts = counting.Counts()
    inner = counts.count_calls(lambda value: value, "cpu()", lambda *_: True)
    outer = counts.count_calls(inner, "to numpy", lambda *_: True)
    outer(1)
    counts.where = "wrapper"
    outer(1)
    with counts.at("environment"):
        inner(1)
        inner(1)
    inner(1)
    with counts.at(None):
        inner(1)
    assert counts.by_place == {"wrapper": {"to numpy": 1, "cpu()": 1}, "environment": {"cpu()": 2}}

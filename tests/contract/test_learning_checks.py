"""Test that the checks of learners and of a package's own vector environment fail where something is wrong.

The libraries are stand-ins: modules of a few lines, right or with one defect. The environments are counters.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

numpy = pytest.importorskip("numpy")

Import = Callable[[str], Any]


class Parameter:
    """A tensor, as far as it is read."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def detach(self) -> Parameter:
        """Return itself."""
        return self

    cpu = detach

    def numpy(self) -> Any:
        """Return the values."""
        return self.values


class Model:
    """A learner of Stable-Baselines3 whose policy is two numbers; `change` is what learning does to them."""

    change: Callable[[Any], Any] = staticmethod(lambda values: values + 1)
    lost = 0

    def __init__(self, policy: str, env: Any, **words: Any) -> None:
        self.weights = numpy.zeros(2)
        self.num_timesteps = 0
        self.policy = SimpleNamespace(parameters=lambda: [Parameter(self.weights)])

    def learn(self, total_timesteps: int) -> None:
        """Change the policy, and count."""
        self.weights = self.change(self.weights)
        self.num_timesteps = total_timesteps - self.lost

    def predict(self, observation: Any, *, deterministic: bool) -> tuple[Any, None]:
        """Return an action for each row."""
        return numpy.zeros(len(observation)), None


class Vector:
    """A vector environment that always observes zeros."""

    observation_space = SimpleNamespace(shape=(2,))
    action_space = SimpleNamespace(n=2)

    def reset(self, **words: Any) -> Any:
        """Return the first observations."""
        return numpy.zeros((4, 2))

    def step(self, actions: Any) -> Any:
        """Return the next observations."""
        return numpy.zeros((4, 2)), numpy.zeros(4), numpy.zeros(4, bool), {}

    def close(self) -> None:
        """Do nothing."""


class Team(Vector):
    """A PettingZoo environment of two agents."""

    possible_agents = ("one", "two")

    def observation_space(self, agent: str) -> Any:  # type: ignore[override]
        """Return a space of two numbers."""
        return SimpleNamespace(shape=(2,))


def a_module(name: str, **contents: Any) -> ModuleType:
    """Return a module with these contents."""
    module = ModuleType(name)
    module.__dict__.update(contents, __version__="1")
    return module


def a_probe() -> Any:
    """Return a probe of a team."""
    api = SimpleNamespace(make_raw=lambda case: Team())
    return SimpleNamespace(case={"seed": 7, "steps": 5, "kwargs": {}}, api=api, num_envs=3)


LEARNING = [
    pytest.param({}, None, id="right"),
    pytest.param({"change": staticmethod(lambda values: values)}, "interop.unchanged", id="nothing learned"),
    pytest.param({"change": staticmethod(lambda values: values * numpy.nan)}, "interop.not_finite", id="no numbers"),
    pytest.param({"lost": 1}, "interop.steps", id="fewer steps"),
]


@pytest.mark.parametrize("check", ["check_interop_sb3_learn", "check_interop_supersuit_sb3_learn"])
@pytest.mark.parametrize(("defect", "code"), LEARNING)
def test_learning_has_to_change_the_policy(
    check: str, defect: dict[str, Any], code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A policy that stays as it was, one that is no numbers, and steps that are lost are refused."""
    sb3 = a_module("stable_baselines3", PPO=type("PPO", (Model,), defect))
    vectors = a_module("vec_env", DummyVecEnv=lambda makers: Vector())
    supersuit = a_module(
        "supersuit",
        pettingzoo_env_to_vec_env_v1=lambda env: env,
        concat_vec_envs_v1=lambda env, copies, **words: Vector(),
    )
    monkeypatch.setitem(sys.modules, "stable_baselines3", sb3)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common", a_module("common", vec_env=vectors))
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", vectors)
    monkeypatch.setitem(sys.modules, "supersuit", supersuit)

    assert code_of(cell, cell(check), a_probe()) == code


class Algorithm:
    """An algorithm of RLlib."""

    def __init__(self, change: Callable[[Any], Any], earned: float | None) -> None:
        self.weights, self.change, self.earned = numpy.zeros(2), change, earned

    def get_weights(self) -> Any:
        """Return the weights by policy."""
        return {"default_policy": {"layer": self.weights}}

    def train(self) -> Any:
        """Change the weights, and count."""
        self.weights = self.change(self.weights)
        return {"env_runners": {"num_env_steps_sampled_lifetime": 64}}

    def evaluate(self) -> Any:
        """Return what an episode earned."""
        return {"env_runners": {"episode_return_mean": self.earned}}

    def stop(self) -> None:
        """Do nothing."""


class Configuration:
    """A configuration of RLlib: each method returns it."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("num_") or name in ("minibatch_size", "sgd_minibatch_size"):
            raise AttributeError(name)
        return lambda *values, **words: self


@pytest.mark.parametrize(
    ("change", "earned", "code"),
    [
        pytest.param(lambda weights: weights + 1, 9.0, None, id="right"),
        pytest.param(lambda weights: weights, 9.0, "interop.unchanged", id="nothing learned"),
        pytest.param(lambda weights: weights * numpy.nan, 9.0, "interop.not_finite", id="no numbers"),
        pytest.param(lambda weights: weights + 1, numpy.nan, "interop.return", id="return is no number"),
        pytest.param(lambda weights: weights + 1, None, "interop.return", id="no return"),
    ],
)
def test_rllib_has_to_learn_and_to_evaluate(
    change: Any, earned: float | None, code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Weights that stay, weights that are no numbers, and an evaluation without a return are refused."""
    configuration = type("PPOConfig", (Configuration,), {"build": lambda self: Algorithm(change, earned)})
    modules = {
        "ray": a_module("ray", init=lambda **words: None, shutdown=lambda: None),
        "ray.rllib.algorithms.ppo": a_module("ppo", PPOConfig=configuration),
        "ray.tune.registry": a_module("registry", register_env=lambda name, make: None),
        "torch": a_module("torch", manual_seed=lambda seed: None),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)

    assert code_of(cell, cell("check_interop_rllib_learn"), a_probe()) == code


def code_of(cell: Import, check: Any, probe: Any) -> str | None:
    """Run a check, and return the code of its violation."""
    violation = cell("cell_errors").ContractViolation
    try:
        check.run(probe, {})
    except violation as error:
        return str(error.observed["code"])
    return None

"""Test that checks of data sets, vector environments and trainers fail where a library gives wrong values.

The libraries are stand-ins: modules of a few lines, right or with one defect.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

numpy = pytest.importorskip("numpy")

Import = Callable[[str], Any]


class Space:
    """A space whose samples count up."""

    shape = (2,)

    def __init__(self) -> None:
        self.number = 0

    def seed(self, seed: int) -> None:
        """Begin to count at the seed."""
        self.number = seed

    def sample(self) -> Any:
        """Return the next sample."""
        self.number += 1
        return numpy.full(2, self.number)

    def __str__(self) -> str:
        return "Space"


class World:
    """An environment that observes its seed plus its steps; its reward is two numbers."""

    def __init__(self) -> None:
        self.observation_space, self.action_space = Space(), Space()
        self.state = 0

    def reset(self, seed: int) -> Any:
        """Start an episode."""
        self.state = seed
        return numpy.full(2, self.state), {}

    def step(self, action: Any) -> Any:
        """Make a step."""
        self.state += 1
        return numpy.full(2, self.state), numpy.array([self.state, action[0]]), False, False, {}

    def close(self) -> None:
        """Do nothing."""


def a_probe(world: type = World) -> Any:
    """Return a probe of such a world."""
    api = SimpleNamespace(make_raw=lambda case: world(), limit_steps=lambda raw, steps: raw)
    return SimpleNamespace(case={"seed": 7, "steps": 5, "kwargs": {}}, api=api, num_envs=3)


def a_minari(change: Callable[[list[Any]], Any], spaces: str = "Space") -> ModuleType:
    """Return a stand-in for Minari, which loads the episodes of its last collector, changed."""
    module = ModuleType("minari")
    kept: list[Any] = []

    class Collector(World):
        """A world that keeps its episodes."""

        def __init__(self, env: Any) -> None:
            super().__init__()

        def reset(self, seed: int) -> Any:
            values = super().reset(seed)
            kept.append({name: [] for name in ("actions", "rewards", "terminations", "truncations")})
            kept[-1]["observations"] = [values[0]]
            return values

        def step(self, action: Any) -> Any:
            values = super().step(action)
            names = ("observations", "rewards", "terminations", "truncations")
            for name, value in zip(names, values[:4], strict=True):
                kept[-1][name].append(value)
            kept[-1]["actions"].append(action)
            return values

        def create_dataset(self, name: str, **words: str) -> None:
            """Do nothing: the episodes are kept."""

    def load(name: str) -> Any:
        return SimpleNamespace(
            total_steps=1,
            observation_space=spaces,
            action_space="Space",
            iterate_episodes=lambda: [SimpleNamespace(**episode) for episode in change(kept)],
            recover_environment=World,
        )

    module.DataCollector, module.load_dataset, module.__version__ = Collector, load, "1"  # type: ignore[attr-defined]
    return module


def without_last_action(episodes: list[Any]) -> list[Any]:
    """Return the episodes, the last action of the first changed."""
    return [{**episodes[0], "actions": [*episodes[0]["actions"][:-1], numpy.zeros(2)]}, *episodes[1:]]


@pytest.mark.parametrize(
    ("change", "spaces", "code"),
    [
        (list, "Space", None),
        (lambda episodes: episodes[:1], "Space", "minari.episodes"),
        (without_last_action, "Space", "minari.differs"),
        (list, "Box", "minari.spaces"),
    ],
    ids=["right", "episode lost", "action changed", "other space"],
)
def test_a_data_set_is_compared(
    change: Any, spaces: str, code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Episodes, values and spaces have to be those that were recorded."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", "")
    monkeypatch.setitem(sys.modules, "minari", a_minari(change, spaces))

    assert code_of(cell, cell("check_interop_minari_dataset")) == code


def a_mo_gymnasium(change: Callable[[Any], Any]) -> ModuleType:
    """Return a stand-in for MO-Gymnasium, whose vector environment changes the rewards."""
    module = ModuleType("mo_gymnasium")

    class Vector:
        """Worlds in a row."""

        def __init__(self, makers: Any) -> None:
            self.worlds = [make() for make in makers]
            self.action_space = SimpleNamespace(
                seed=lambda seed: None, sample=lambda: numpy.ones((len(self.worlds), 2))
            )

        def reset(self, seed: int) -> None:
            for number, world in enumerate(self.worlds):
                world.reset(seed + number)

        def step(self, actions: Any) -> Any:
            values = [world.step(action) for world, action in zip(self.worlds, actions, strict=True)]
            return None, change(numpy.array([value[1] for value in values])), None, None, {}

        def close(self) -> None:
            """Do nothing."""

    module.MOSyncVectorEnv = Vector  # type: ignore[attr-defined]
    return module


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda rewards: rewards, None),
        (lambda rewards: rewards.sum(axis=1), "mo_gymnasium.shape"),
        (lambda rewards: rewards[::-1], "mo_gymnasium.rewards"),
    ],
    ids=["right", "one number", "exchanged"],
)
def test_rewards_of_several_numbers_are_compared(
    change: Any, code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rewards of a vector environment have to be those of single ones."""
    monkeypatch.setitem(sys.modules, "mo_gymnasium", a_mo_gymnasium(change))

    assert code_of(cell, cell("check_interop_mo_gymnasium_vector")) == code


class Team:
    """Two agents that act at once; each observes its place plus the steps, and earns its action."""

    possible_agents = ("one", "two")

    def __init__(self) -> None:
        self.spaces = {agent: Space() for agent in self.possible_agents}
        self.agents = list(self.possible_agents)
        self.state = 0

    def observation_space(self, agent: str) -> Any:
        """Return the space of what an agent observes."""
        return self.spaces[agent]

    action_space = observation_space

    def reset(self, seed: int) -> Any:
        """Start an episode."""
        self.state = seed
        return self._observe(), {}

    def step(self, actions: Any) -> Any:
        """Make a step."""
        self.state += 1
        return self._observe(), {agent: action[0] for agent, action in actions.items()}, {}, {}, {}

    def _observe(self) -> Any:
        return {agent: numpy.full(2, self.state + place) for place, agent in enumerate(self.agents)}

    def close(self) -> None:
        """Do nothing."""


def a_supersuit(change: Callable[[Any, Any], Any]) -> ModuleType:
    """Return a stand-in for SuperSuit, whose vector environment changes observations and rewards."""
    module = ModuleType("supersuit")

    class Vector:
        """The agents of all copies in a row."""

        def __init__(self, copies: int) -> None:
            self.teams = [Team() for _ in range(copies)]

        def reset(self, seed: int) -> Any:
            rows = [row for team in self.teams for row in team.reset(seed)[0].values()]
            return change(numpy.array(rows), None)[0], {}

        def step(self, actions: Any) -> Any:
            pairs = zip(self.teams, actions.reshape(len(self.teams), 2, 2), strict=True)
            values = [team.step(dict(zip(team.agents, pair, strict=True)))[:2] for team, pair in pairs]
            rows, earned = ([each for value in values for each in value[part].values()] for part in (0, 1))
            ends = numpy.zeros(len(rows), bool)
            return *change(numpy.array(rows), numpy.array(earned)), ends, ends, {}

        def close(self) -> None:
            """Do nothing."""

    module.__version__ = "1"  # type: ignore[attr-defined]
    module.pettingzoo_env_to_vec_env_v1 = lambda env: env  # type: ignore[attr-defined]
    module.concat_vec_envs_v1 = lambda env, copies, **words: Vector(copies)  # type: ignore[attr-defined]
    return module


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda rows, earned: (rows, earned), None),
        (lambda rows, earned: (rows[:2], earned), "supersuit.shape"),
        (lambda rows, earned: (rows[::-1], earned), "supersuit.differs"),
        (lambda rows, earned: (rows, None if earned is None else earned + 1), "supersuit.differs"),
    ],
    ids=["right", "copy lost", "agents exchanged", "other rewards"],
)
def test_a_vector_environment_of_agents_is_compared(
    change: Any, code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first copy has to observe and earn what the environment itself gives."""
    monkeypatch.setitem(sys.modules, "supersuit", a_supersuit(change))

    assert code_of(cell, cell("check_interop_supersuit_vec_env"), Team) == code


def a_brax(learns: bool, score: float) -> dict[str, ModuleType]:
    """Return stand-ins for Brax's modules and JAX: its trainer counts steps, and learns or does not."""
    names = ("jax", "brax", "brax.envs", "brax.training", "brax.training.agents", "brax.training.agents.ppo")
    modules = {name: ModuleType(name) for name in (*names, "brax.training.agents.ppo.train")}

    def train(*, environment: str, progress_fn: Any, policy_params_fn: Any, **words: Any) -> None:
        assert environment == "fast"
        for step in range(3):
            progress_fn(step, {"eval/episode_reward": score})
            policy_params_fn(step, None, ([numpy.array(step)], [numpy.array(step if learns else 1)]))

    modules["brax"].__version__ = modules["jax"].__version__ = "1"  # type: ignore[attr-defined]
    modules["jax"].tree_util = SimpleNamespace(tree_leaves=list)  # type: ignore[attr-defined]
    modules["brax.envs"].get_environment = lambda name: name  # type: ignore[attr-defined]
    modules["brax.training.agents.ppo.train"].train = train  # type: ignore[attr-defined]
    return modules


@pytest.mark.parametrize(
    ("learns", "score", "code"),
    [(True, 1.0, None), (False, 1.0, "interop.unchanged"), (True, float("nan"), "interop.return")],
    ids=["right", "policy unchanged", "no score"],
)
def test_the_policy_of_brax_has_to_change(
    learns: bool, score: float, code: str | None, cell: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The count of steps that is kept beside the policy changes in any case, and proves nothing."""
    for name, module in a_brax(learns, score).items():
        monkeypatch.setitem(sys.modules, name, module)

    probe = SimpleNamespace(case={"env": "brax:fast", "api": "brax", "kwargs": {}, "seed": 0})
    assert code_of(cell, cell("check_interop_brax_learn"), probe=probe) == code


def code_of(cell: Import, check: Any, world: type = World, probe: Any = None) -> str | None:
    """Run a check, and return the code of its violation."""
    violation = cell("cell_errors").ContractViolation
    try:
        check.run(probe or a_probe(world), {})
    except violation as error:
        return str(error.observed["code"])
    return None

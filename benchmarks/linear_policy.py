"""Make a linear policy for an environment of gymnasium by random search, for `policy` of a matrix.

`python -m benchmarks.linear_policy Hopper-v5 --out matrices/policies/hopper-v5.json`, in an environment that has
gymnasium and numpy alone: nothing of the harness is imported. The search is the one of Mania, Guy and Recht, "Simple
random search of static linear policies is competitive for reinforcement learning" (2018): observations are normalised,
the best of several directions make a step. The same versions and the same seed make the same policy.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

EPISODES = 100
"""Episodes in which the scale of the returns is measured."""

FIRST_SEED = 1_000_000
"""Seeds of resets begin here, so that none is one of those that are played later."""


@dataclass
class Search:
    """The state of a search: the weights, and the mean and the squared deviations of the observations."""

    env: Any
    size: int
    actions: int
    discrete: bool
    dice: np.random.Generator
    shift: float
    horizon: int
    seed: int = FIRST_SEED
    count: float = 1e-4
    weights: np.ndarray = field(init=False)
    mean: np.ndarray = field(init=False)
    spread: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        """Start from a policy that does nothing."""
        self.weights = np.zeros((self.actions, self.size))
        self.mean, self.spread = np.zeros(self.size), np.zeros(self.size)

    @property
    def scale(self) -> np.ndarray:
        """Return the standard deviation of each number of the observations; 1 for one that never moves."""
        deviation = np.sqrt(self.spread / self.count)
        return np.where(deviation < 1e-6, 1.0, deviation)

    def action(self, weights: np.ndarray, observation: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> Any:
        """Return the action of a policy."""
        values = weights @ ((observation - mean) / scale)
        if self.discrete:
            return int(np.argmax(values))
        space = self.env.action_space
        return np.clip(values, space.low, space.high).astype(space.dtype)

    def play(self, weights: np.ndarray, *, learn: bool = False, random: bool = False) -> tuple[float, float]:
        """Play an episode with weights, or with random actions; return its return, and that without the shift."""
        mean, scale = self.mean.copy(), self.scale.copy()
        self.seed += 1
        observation, _ = self.env.reset(seed=self.seed)
        total, steps = 0.0, 0
        for _ in range(self.horizon):
            if learn:
                self.count += 1
                step = observation - self.mean
                self.mean += step / self.count
                self.spread += step * (observation - self.mean)
            action = self.env.action_space.sample() if random else self.action(weights, observation, mean, scale)
            observation, reward, terminated, truncated, _ = self.env.step(action)
            total, steps = total + float(reward), steps + 1
            if terminated or truncated:
                break
        return total - self.shift * steps, total

    def improve(self, step: float, noise: float, directions: int, best: int) -> None:
        """Make one step of the search."""
        tried = []
        for _ in range(directions):
            direction = self.dice.standard_normal(self.weights.shape)
            ups, downs = (self.play(self.weights + sign * noise * direction, learn=True)[0] for sign in (1, -1))
            tried.append((max(ups, downs), ups, downs, direction))
        chosen = sorted(tried, key=lambda one: -one[0])[:best]
        deviation = np.std([value for one in chosen for value in one[1:3]]) or 1.0
        self.weights += (
            step / (best * deviation) * sum((ups - downs) * direction for _, ups, downs, direction in chosen)
        )


def main() -> None:
    """Search, measure the scale of the returns, and write the policy."""
    parser = argparse.ArgumentParser()
    parser.add_argument("env")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--step", type=float, default=0.01)
    parser.add_argument("--noise", type=float, default=0.025)
    parser.add_argument("--directions", type=int, default=8)
    parser.add_argument("--best", type=int, default=4)
    parser.add_argument("--shift", type=float, default=0.0, help="reward for staying alive, which is not counted")
    parser.add_argument("--horizon", type=int, default=1000)
    args = parser.parse_args()
    import gymnasium  # noqa: PLC0415 - `--help` needs none

    env = gymnasium.make(args.env).unwrapped
    env.action_space.seed(args.seed)
    discrete = hasattr(env.action_space, "n")
    search = Search(
        env=env,
        size=int(np.prod(env.observation_space.shape)),
        actions=int(env.action_space.n) if discrete else int(np.prod(env.action_space.shape)),
        discrete=discrete,
        dice=np.random.default_rng(args.seed),
        shift=args.shift,
        horizon=args.horizon,
    )
    best, began = (-np.inf, search.weights, search.mean, search.scale), time.monotonic()
    for number in range(1, args.iterations + 1):
        search.improve(args.step, args.noise, args.directions, args.best)
        if number % 10 == 0:
            score = float(np.mean([search.play(search.weights)[1] for _ in range(10)]))
            if score > best[0]:
                best = score, search.weights.copy(), search.mean.copy(), search.scale.copy()
            print(f"{number}: {score:.1f}, best {best[0]:.1f}, {time.monotonic() - began:.0f} s", flush=True)
    _, weights, search.mean, scale = (np.round(one, 5) for one in best)
    search.count, search.spread = 1.0, scale**2
    full = np.mean([search.play(weights)[1] for _ in range(EPISODES)])
    none = np.mean([search.play(weights, random=True)[1] for _ in range(EPISODES)])
    options = {name: value for name, value in vars(args).items() if name not in {"env", "out"}}
    policy = {
        "form": 1,
        "env": args.env,
        "origin": {
            "by": "benchmarks/linear_policy.py",
            "options": options,
            "versions": {"python": platform.python_version(), **versions()},
        },
        "scale": {"random": round(float(none), 3), "policy": round(float(full), 3)},
        "mean": search.mean.tolist(),
        "deviation": scale.tolist(),
        "weights": weights.tolist(),
    }
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(policy, indent=1) + "\n")
    print(f"random {none:.1f}, policy {full:.1f}: {args.out}")


def versions() -> dict[str, str]:
    """Return the versions of the packages that a policy depends on, as far as they are there."""
    packages = {}
    for name in ("gymnasium", "mujoco", "numpy"):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            continue
    return packages


if __name__ == "__main__":
    main()

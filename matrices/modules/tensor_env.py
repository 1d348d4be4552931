"""Many worlds in one environment of torch tensors, whose first dimension they are, as in Isaac Lab.

A point in each world is pushed about a plane. Episodes end by themselves, and where they do the next one begins in the
same step.
"""

from types import MappingProxyType

import gymnasium
import torch
from gymnasium import spaces

LIMIT = 8.0
PUSH = 0.1


class World:
    """`num_envs` points, the episode of each `length` steps long, or of its own length (`apart`).

    With `reuse` every step writes into the same tensors and returns those, as simulators do that give views of their
    own memory.
    """

    metadata = MappingProxyType({"render_modes": ()})
    render_mode = None
    spec = None

    def __init__(self, observations="box", num_envs=4, length=20, apart=False, reuse=False, device="cpu"):
        self.num_envs = num_envs
        self.device = torch.device(device)
        self.lengths = torch.full((num_envs,), length, device=self.device)
        if apart:
            self.lengths = self.lengths + torch.arange(num_envs, device=self.device)
        self.reuse = reuse
        self.dict = observations == "dict"
        self.given = {}
        self.generator = torch.Generator(device=self.device)
        self.position = torch.zeros(num_envs, 2, device=self.device)
        self.age = torch.zeros(num_envs, dtype=torch.long, device=self.device)

    def describe(self):
        """Say what one world takes and gives, and what all of them do."""
        self.single_action_space = spaces.Box(-1.0, 1.0, (2,), "float32")
        self.action_space = spaces.Box(-1.0, 1.0, (self.num_envs, 2), "float32")
        self.single_observation_space = self.space(())
        self.observation_space = self.space((self.num_envs,))

    def space(self, worlds):
        """Return the space of observations with these dimensions before those of one world."""
        policy = spaces.Box(-LIMIT, LIMIT, (*worlds, 2), "float32")
        age = spaces.Box(0.0, 1.0, (*worlds, 1), "float32")
        return spaces.Dict({"policy": policy, "age": age}) if self.dict else policy

    def reset(self, *, seed=None, options=None):
        """Begin episodes, in all worlds or in those of `options["reset_mask"]`."""
        if seed is not None:
            self.generator.manual_seed(seed)
        mask = (options or {}).get("reset_mask")
        self.begin(torch.ones_like(self.age, dtype=torch.bool) if mask is None else torch.as_tensor(mask))
        return self.observe(), {}

    def begin(self, where):
        """Begin episodes in these worlds."""
        start = 2 * torch.rand(self.num_envs, 2, generator=self.generator, device=self.device) - 1
        self.position = torch.where(where[:, None], start, self.position)
        self.age = torch.where(where, torch.zeros_like(self.age), self.age)

    def step(self, action):
        """Push all points; an array of numpy's is taken, too, at the price of a conversion."""
        self.position = (self.position + PUSH * torch.as_tensor(action, device=self.device)).clamp(-LIMIT, LIMIT)
        self.age = self.age + 1
        reward = self.give("reward", -self.position.norm(dim=-1))
        truncated = self.give("truncated", self.age >= self.lengths)
        terminated = self.give("terminated", torch.zeros_like(truncated))
        info = self.finish(truncated)
        return self.observe(), reward, terminated, truncated, info

    def finish(self, ended):
        """Begin the next episode in the worlds whose episode has ended."""
        if ended.any():
            self.begin(ended)
        return {}

    def observe(self):
        """Return the observation of all worlds."""
        policy = self.give("policy", self.position)
        if not self.dict:
            return policy
        return {"policy": policy, "age": self.give("age", (self.age / self.lengths).clamp(max=1.0)[:, None])}

    def give(self, name, value):
        """Return the value in memory of its own, or in that of the step before."""
        if not self.reuse:
            return value.clone()
        return self.given.setdefault(name, torch.empty_like(value)).copy_(value)

    def render(self):
        """Draw nothing."""

    def close(self, **_):
        """Do nothing: there is nothing to release."""


class Environment(World, gymnasium.Env):
    """A gymnasium.Env with `num_envs`, as Isaac Lab's."""

    def __init__(self, **options):
        World.__init__(self, **options)
        self.describe()


class Copied(Environment):
    """The same, and whatever it gives is a copy: what a user can do about one that reuses its memory."""

    def step(self, action):
        """Step, and copy what came of it."""
        observation, reward, terminated, truncated, info = super().step(action)
        copy = {name: part.clone() for name, part in observation.items()} if self.dict else observation.clone()
        return copy, reward.clone(), terminated.clone(), truncated.clone(), info


class Vector(World, gymnasium.vector.VectorEnv):
    """A gymnasium.vector.VectorEnv, of which gymnasium knows how its episodes begin anew.

    `autoreset` is `SAME_STEP`, or `DISABLED`: then whoever drives it resets the worlds whose episode has ended.
    """

    def __init__(self, autoreset="SAME_STEP", **options):
        World.__init__(self, **options)
        self.describe()
        self.resets = autoreset == "SAME_STEP"
        modes = getattr(gymnasium.vector, "AutoresetMode", None)  # since gymnasium 1.1
        self.autoreset_mode = modes[autoreset] if modes else None
        self.metadata = dict(self.metadata, autoreset_mode=self.autoreset_mode)
        self.last = "final_obs" if modes else "final_observation"

    def finish(self, ended):
        """Keep the last observations, and begin the next episodes, if that is left to us."""
        if not self.resets or not ended.any():
            return {}
        last = self.observe()
        self.begin(ended)
        return {self.last: last, "_" + self.last: ended}


def make(kind="environment", **options):
    """Make one: an `environment`, a `copied` one, or a `vector` environment."""
    return {"environment": Environment, "copied": Copied, "vector": Vector}[kind](**options)

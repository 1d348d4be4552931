"""Drive gymnax by its own `make`: `gymnax:CartPole-v1`, compiled; several environments are one by `jax.vmap`."""

import importlib

from .cell_adapter import Adapter
from .cell_batched_worlds import Worlds
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import describe_value

PACKAGES = {"gymnax": "gymnax"}
IDS = r"[A-Za-z][A-Za-z0-9-]*"
EXAMPLE = "gymnax:CartPole-v1"


class Gymnax(Adapter):
    """The calls of a user: `make`, then `reset` and `step` with a key, a state and parameters."""

    imports = ("jax", "gymnax")

    def environment_names(self):
        """Return the names of all registered environments."""
        return [str(name) for name in importlib.import_module("gymnax").registered_envs]

    def make(self, case, report, draw=False):
        """Make one environment."""
        if draw:
            skip("worlds.no_pictures", name="gymnax")
        return Task(case, report)

    def make_vector(self, makers, options, report):
        """Make a batch of environments, which reset by themselves; there are no workers."""
        if options is not None:
            skip("worlds.no_workers", name="gymnax")
        return Task(makers[0].case, report, worlds=len(makers))


class Task(Worlds):
    """An environment of pure functions: a key, a state and an action go in, all else comes out."""

    def __init__(self, case, report, worlds=None):
        import numpy as np

        self.jax = jax = importlib.import_module("jax")
        gymnax = importlib.import_module("gymnax")
        with library:
            self.env, self.parameters = gymnax.make(local_name(case), **case["kwargs"])
            self.size = tuple(self.env.observation_space(self.parameters).shape)
            space = self.env.action_space(self.parameters)
            self.number = int(space.n) if hasattr(space, "n") else None
            self.resetting, self.stepping = self.env.reset, self.env.step
            if worlds is not None:
                self.resetting = jax.vmap(self.resetting, in_axes=(0, None))
                self.stepping = jax.vmap(self.stepping, in_axes=(0, 0, 0, None))
            self.resetting, self.stepping = jax.jit(self.resetting), jax.jit(self.stepping)
            self.key = jax.random.PRNGKey(case["seed"])
        ends = (
            [np.zeros(1)] * 2 if self.number else [np.broadcast_to(end, space.shape) for end in (space.low, space.high)]
        )
        super().__init__(report, worlds, *ends)
        self.state = None

    def _next_keys(self):
        """Return a new key, or one for each environment."""
        self.key, used = self.jax.random.split(self.key)
        return self.jax.random.split(used, self.shape[0]) if self.shape else used

    def begin(self, seed):
        """Begin with the key of a seed, or with the next one."""
        if seed is not None:
            self.key = self.jax.random.PRNGKey(seed)
        observation, self.state = self.resetting(self._next_keys(), self.parameters)
        return self.copy_array(place("the observation"), observation, self.size)

    def advance(self, action):
        """Make one step. Since 1.0 it gives two flags, before that one, `done`."""
        result = self.stepping(self._next_keys(), self.state, self.jax.numpy.asarray(action), self.parameters)
        if not isinstance(result, tuple) or len(result) not in {5, 6}:
            violate("call.result", call="step()", got=describe_value(result), promised="5 or 6 values")
        observation, self.state, reward, terminated = result[:4]
        reward = self.copy_array(place("the reward"), reward * 1.0, ())
        truncated = result[4] if len(result) == 6 else terminated & False
        flags = [self.jax.device_get(flag) for flag in (terminated, truncated)]
        return (self.copy_array(place("the observation"), observation, self.size), reward, *flags)

    def action(self):
        """Draw an action for each environment."""
        if self.number is None:
            return super().action()
        return self.random.randint(self.number, size=self.shape or None)

    def get_state(self):
        """Return the state and the key."""
        return self.state, self.key

    def set_state(self, state):
        """Go on from a state and a key."""
        self.state, self.key = state

    def close(self):
        """Close nothing: an environment of pure functions holds nothing open."""

    def describe(self):
        """Return the device and the spaces."""
        with library:
            return {
                "device": str(self.jax.devices()[0]),
                "observation_shape": str(self.size),
                "actions": self.number or str((self.low.min(), self.high.max())),
            }


API = Gymnax()

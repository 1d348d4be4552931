"""Drive Brax: `brax:ant`, under the backend that `kwargs.backend` names."""

import importlib

from .cell_adapter import Adapter
from .cell_batched_worlds import Worlds
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import as_numbers

PACKAGES = {"brax": "brax"}
IDS = r"[a-z][a-z0-9_]*"
EXAMPLE = "brax:ant"

HEIGHT, WIDTH = 240, 320
EPISODE = 1000


class Brax(Adapter):
    """The calls of a user: get_environment, a compiled reset and step; create with a batch size."""

    imports = ("jax", "brax", "brax.envs")

    def make(self, case, report, draw=False):
        """Make one environment."""
        envs = importlib.import_module("brax.envs")
        with library:
            raw = envs.get_environment(local_name(case), **case["kwargs"])
        return Task(raw, report, draw=draw)

    def make_vector(self, makers, options, report):
        """Make a batch of environments, which reset by themselves; there are no workers."""
        if options is not None:
            skip("brax.no_workers")
        envs = importlib.import_module("brax.envs")
        case = makers[0].case
        with library:
            raw = envs.create(local_name(case), episode_length=EPISODE, batch_size=len(makers), **case["kwargs"])
        return Task(raw, report, worlds=len(makers))


class Task(Worlds):
    """An environment of pure functions: a state goes in, another comes out."""

    def __init__(self, raw, report, worlds=None, draw=False):
        import numpy as np

        self.jax = jax = importlib.import_module("jax")
        self.raw = raw
        with library:
            self.image = importlib.import_module("brax.io.image") if draw else None
            actions = np.ones(raw.action_size)
            self.size = raw.observation_size
            self.resetting, self.stepping = jax.jit(raw.reset), jax.jit(raw.step)
            self.key = jax.random.PRNGKey(0)
        super().__init__(report, worlds, -actions, actions)
        self.state = None

    def begin(self, seed):
        """Begin with the key of a seed, or with the next one."""
        key = self.key if seed is None else self.jax.random.PRNGKey(seed)
        self.key, used = self.jax.random.split(key)
        self.state = self.resetting(used)
        return self.copy_array(place("the observation"), self.state.obs, (self.size,))

    def advance(self, action):
        """Make one step; Brax says 0.0 or 1.0 for whether an episode is done."""
        self.state = self.stepping(self.state, self.jax.numpy.asarray(action))
        reward = self.copy_array(place("the reward"), self.state.reward, ())
        done = self.copy_array(place("done"), self.state.done, ())
        if not bool(((done == 0) | (done == 1)).all()):
            violate("brax.done", got=str(done))
        truncated = as_numbers(self.state.info.get("truncation", 0 * done), place("truncation")) != 0
        observation = self.copy_array(place("the observation"), self.state.obs, (self.size,))
        return observation, reward, (done != 0) & ~truncated, truncated

    def draw(self):
        """Draw by the library's own image module."""
        state = getattr(self.state, "pipeline_state", None)
        return self.image.render_array(self.raw.sys, state, HEIGHT, WIDTH)

    def get_state(self):
        """Return the state."""
        return self.state

    def set_state(self, state):
        """Go on from a state."""
        self.state = state

    def close(self):
        """Close nothing: an environment of pure functions holds nothing open."""

    def describe(self):
        """Return the device, the backend, and the sizes."""
        with library:
            return {
                "device": str(self.jax.devices()[0]),
                "backend": str(getattr(self.raw, "backend", "?")),
                "observation_size": int(self.size),
                "action_size": int(self.low.size),
            }


API = Brax()

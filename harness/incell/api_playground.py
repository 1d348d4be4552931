"""Drive MuJoCo Playground: `playground:CartpoleBalance`; `kwargs` change its configuration, such as `impl`."""

import importlib

from .api_brax import Task
from .cell_adapter import Adapter
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import as_numbers

PACKAGES = {"playground": "mujoco_playground"}
IDS = r"[A-Z][A-Za-z0-9]*"
EXAMPLE = "playground:CartpoleBalance"


class Playground(Adapter):
    """The calls of a user: `registry.load`, then a compiled reset and step."""

    imports = ("jax", "mujoco_playground")

    def environment_names(self):
        """Return the names of all environments."""
        return [str(name) for name in importlib.import_module("mujoco_playground").registry.ALL_ENVS]

    def make(self, case, report, draw=False):
        """Make one environment."""
        return State(_load(case), report, draw=draw)

    def make_vector(self, makers, options, report):
        """Make a batch by `jax.vmap`; there are no workers."""
        if options is not None:
            skip("worlds.no_workers", name="Playground")
        return State(_load(makers[0].case), report, worlds=len(makers))


def _load(case):
    """Load an environment, with the keywords of the case in place of those of its configuration."""
    registry = importlib.import_module("mujoco_playground").registry
    with library:
        return registry.load(local_name(case), config_overrides=case["kwargs"] or None)


class State(Task):
    """An environment like Brax's: a flag alone says that an episode is done, and nothing resets by itself."""

    def __init__(self, raw, report, worlds=None, draw=False):
        super().__init__(raw, report, worlds)
        if worlds is not None:
            with library:
                self.resetting = self.jax.jit(self.jax.vmap(raw.reset))
                self.stepping = self.jax.jit(self.jax.vmap(raw.step))

    def begin(self, seed):
        """Begin with the key of a seed, or with the next one."""
        key = self.key if seed is None else self.jax.random.PRNGKey(seed)
        self.key, used = self.jax.random.split(key)
        self.state = self.resetting(self.jax.random.split(used, self.shape[0]) if self.shape else used)
        return self._observation()

    def advance(self, action):
        """Make one step."""
        self.state = self.stepping(self.state, self.jax.numpy.asarray(action))
        reward = self.copy_array(place("the reward"), self.state.reward, ())
        done = as_numbers(self.state.done, place("done"))
        if not bool(((done == 0) | (done == 1)).all()):
            violate("brax.done", got=str(done))
        over = done != 0
        return self._observation(), reward, over, over & False

    def _observation(self):
        """Copy the observation, or its parts, in the sizes that the environment promises."""
        parts = self.state.obs
        if not isinstance(parts, dict):
            return self.copy_array(place("the observation"), parts, (self.size,))
        return {name: self.copy_array(place(name), part, self.size[name]) for name, part in parts.items()}

    def draw(self):
        """Draw by the environment's own renderer."""
        return self.raw.render(self.state, height=240, width=320)

    def describe(self):
        """Return the device, the implementation, and the sizes."""
        with library:
            return {
                "device": str(self.jax.devices()[0]),
                "impl": str(getattr(self.raw.mjx_model, "impl", "jax")),
                "observation_size": str(self.size),
                "action_size": int(self.low.size),
            }


API = Playground()

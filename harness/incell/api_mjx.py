"""Drive MJX, MuJoCo on JAX: `mjx:sphere` is a scene of ours, `mjx:FILE.xml` a model of one's own."""

import importlib

from .cell_batched_worlds import Worlds, WorldsAdapter
from .cell_errors import library
from .cell_observation import place
from .cell_scenes import load_model

PACKAGES = {"mujoco-mjx": "mujoco.mjx"}
IDS = r".+\.xml"
EXAMPLE = "mjx:sphere"


class Mjx(WorldsAdapter):
    """The calls of a user: put_model, make_data, a compiled step, vmap over worlds."""

    name = "MJX"
    imports = ("jax", "mujoco", "mujoco.mjx")

    def simulate(self, case, report, worlds=None):
        """Put a model on the device."""
        return Simulation(case, report, worlds)


class Simulation(Worlds):
    """A model that is stepped with random controls; the same start each time. Its data never change: new ones come."""

    def __init__(self, case, report, worlds):
        self.jax = jax = importlib.import_module("jax")
        mjx = importlib.import_module("mujoco.mjx")
        model = load_model(importlib.import_module("mujoco"), case)
        self.source = model
        super().__init__(report, worlds, *model.actuator_ctrlrange.T)
        self.sizes = {"qpos": (model.nq,), "qvel": (model.nv,)}
        put = getattr(mjx, "put_model", None) or mjx.device_put  # before MJX 3.1
        with library:
            self.model = put(model, **case["kwargs"])
            start = mjx.make_data(self.model)
            if worlds is not None:
                start = jax.vmap(lambda _: start)(jax.numpy.arange(worlds))
            self.start = self.data = start
            self.forward = jax.jit(mjx.step if worlds is None else jax.vmap(mjx.step, in_axes=(None, 0)))

    def begin(self, seed):
        """Go back to where the model starts."""
        self.data = self.start
        return self._observed()

    def advance(self, action):
        """Make one step of all worlds."""
        self.data = self.forward(self.model, self.data.replace(ctrl=self.jax.numpy.asarray(action)))
        return self.complete_step(self._observed())

    def _observed(self):
        return {name: self.copy_array(place(name), getattr(self.data, name), size) for name, size in self.sizes.items()}

    def get_state(self):
        """Return the data."""
        return self.data

    def set_state(self, state):
        """Go on from data."""
        self.data = state

    def describe(self):
        """Return the device, and the sizes of the model."""
        with library:
            return {"device": str(self.jax.devices()[0]), "nq": self.sizes["qpos"][0], "nv": self.sizes["qvel"][0]}


API = Mjx()

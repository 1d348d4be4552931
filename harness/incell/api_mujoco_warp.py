"""The adapter of MuJoCo Warp: `mujoco_warp:sphere` is a scene of ours, `mujoco_warp:FILE.xml` a model of one's own."""

import importlib

from .cell_errors import library
from .cell_observed import place
from .cell_scene import load
from .cell_worlds import World, Worlds

PACKAGES = {"mujoco-warp": "mujoco_warp"}
IDS = r".+\.xml"
EXAMPLE = "mujoco_warp:sphere"

STATE = ("time", "qpos", "qvel", "act", "qacc_warmstart")


class MujocoWarp(Worlds):
    """The calls of a user: put_model, make_data with the number of worlds, step."""

    name = "MuJoCo Warp"
    imports = ("warp", "mujoco", "mujoco_warp")

    def simulate(self, case, tell, worlds=None):
        """Put a model on the device."""
        return Simulation(case, tell, worlds)


class Simulation(World):
    """A model that is stepped with random controls; the same start each time."""

    def __init__(self, case, tell, worlds):
        self.library = mujoco_warp = importlib.import_module("mujoco_warp")
        self.source = model = load(importlib.import_module("mujoco"), case)
        super().__init__(tell, worlds, *model.actuator_ctrlrange.T)
        self.sizes = {"qpos": (model.nq,), "qvel": (model.nv,)}
        self.kwargs = dict(case["kwargs"], nworld=worlds or 1)
        with library:
            self.model = mujoco_warp.put_model(model)
            self.data = self._made()

    def _made(self):
        return self.library.make_data(self.source, **self.kwargs)

    def begin(self, seed):
        """Make data anew."""
        self.data = self._made()
        return self._observed()

    def advance(self, action):
        """Make one step of all worlds."""
        self.data.ctrl.assign(action.reshape(self.data.ctrl.shape))
        self.library.step(self.model, self.data)
        return self.stepped(self._observed())

    def _observed(self):
        arrays = {name: getattr(self.data, name).numpy() for name in self.sizes}
        if not self.shape:
            arrays = {name: array[0] for name, array in arrays.items()}
        return {name: self.seen(place(name), array, self.sizes[name]) for name, array in arrays.items()}

    def get_state(self):
        """Return copies of what a simulation goes on from."""
        with library:
            return {name: getattr(self.data, name).numpy().copy() for name in STATE}

    def set_state(self, state):
        """Go back to where a state was taken."""
        with library:
            for name, value in state.items():
                if value.size:
                    getattr(self.data, name).assign(value)

    def describe(self):
        """Return the device, and the sizes of the model."""
        with library:
            return {"device": str(self.data.qpos.device), "nq": self.sizes["qpos"][0], "nv": self.sizes["qvel"][0]}


API = MujocoWarp()

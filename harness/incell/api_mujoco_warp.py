"""Drive MuJoCo Warp: `mujoco_warp:sphere` is a scene of ours, `mujoco_warp:FILE.xml` a model of one's own."""

import importlib

from .cell_batched_worlds import Worlds, WorldsAdapter
from .cell_errors import library
from .cell_observation import place
from .cell_scenes import load_model

PACKAGES = {"mujoco-warp": "mujoco_warp"}
IDS = r".+\.xml"
EXAMPLE = "mujoco_warp:sphere"

STATE = ("time", "qpos", "qvel", "act", "qacc_warmstart")


class MujocoWarp(WorldsAdapter):
    """The calls of a user: put_model, make_data with the number of worlds, step."""

    name = "MuJoCo Warp"
    imports = ("warp", "mujoco", "mujoco_warp")

    def simulate(self, case, report, worlds=None):
        """Put a model on the device."""
        return Simulation(case, report, worlds)


class Simulation(Worlds):
    """A model that is stepped with random controls; the same start each time."""

    def __init__(self, case, report, worlds):
        self.library = mujoco_warp = importlib.import_module("mujoco_warp")
        self.source = model = load_model(importlib.import_module("mujoco"), case)
        super().__init__(report, worlds, *model.actuator_ctrlrange.T)
        self.sizes = {"qpos": (model.nq,), "qvel": (model.nv,)}
        self.kwargs = dict(case["kwargs"], nworld=worlds or 1)
        with library:
            self.model = mujoco_warp.put_model(model)
            self.data = self._make_data()

    def _make_data(self):
        return self.library.make_data(self.source, **self.kwargs)

    def begin(self, seed):
        """Make new data."""
        self.data = self._make_data()
        return self._observed()

    def advance(self, action):
        """Make one step of all worlds."""
        self.data.ctrl.assign(action.reshape(self.data.ctrl.shape))
        self.library.step(self.model, self.data)
        return self.complete_step(self._observed())

    def _observed(self):
        arrays = {name: getattr(self.data, name).numpy() for name in self.sizes}
        if not self.shape:
            arrays = {name: array[0] for name, array in arrays.items()}
        return {name: self.copy_array(place(name), array, self.sizes[name]) for name, array in arrays.items()}

    def get_state(self):
        """Copy the state that a simulation continues from."""
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

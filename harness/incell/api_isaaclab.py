"""The adapter of Isaac Lab 3, which needs no Isaac Sim: `isaaclab:Isaac-Cartpole` is a task under Newton on a CPU.

An environment of Isaac Lab is always a batch, of torch tensors: `kwargs.num_envs` worlds, whose next episodes begin
by themselves. `kwargs.overrides` are those of its configuration, such as `physics=newton_kamino`. A robot that lies on
NVIDIA's servers and no file here stands in for has to be fetched from there.
"""

import importlib
from time import monotonic

from .cell_cartpole import stood_in
from .cell_errors import library, skip, violate
from .cell_observed import place
from .cell_scene import named
from .cell_values import finite, flag, scalar, shown
from .cell_worlds import World, Worlds

PACKAGES = {"isaaclab": "isaaclab"}
NOT_IMPORTED = {
    "isaaclab": "it starts a simulator when it is imported",
    "isaacsim": "it starts a simulator when it is imported",
}
IDS = r"Isaac-[\w-]+"
EXAMPLE = "isaaclab:Isaac-Cartpole-Direct"
NATIVE_ERRORS = (r"\[(?:Error|Fatal)\] \[[\w.-]+\] .+",)

CHOSEN = {"num_envs": 4, "device": "cpu", "overrides": ()}
"""What a case may say of the configuration of a task, and what holds where it does not."""

COLOURS = "rgb"


class IsaacLab(Worlds):
    """The calls of a user: the task's configuration, for the CPU and so many worlds, and gymnasium's make."""

    name = "Isaac Lab"
    imports = ("isaaclab", "isaaclab_tasks")

    def make(self, case, tell, draw=False):
        """Make the environment of a case; its pictures are those of a camera in its scene."""
        if draw:
            with library:
                settings = self.configured(case)
            if not any(COLOURS in getattr(part, "data_types", ()) for part in vars(settings.scene).values()):
                skip("isaaclab.no_camera")
        return self.simulate(case, tell)

    def simulate(self, case, tell, worlds=None):
        """Make a task, of this many worlds where it is asked for them."""
        more = {} if worlds is None else {"num_envs": worlds}
        began = monotonic()
        with library:
            raw = self.bare(case, **more)
        return Task(raw, tell, monotonic() - began)

    def bare(self, case, **more):
        """Make the library's own object; only one may be open at a time in a process."""
        options = {name: value for name, value in case["kwargs"].items() if name not in CHOSEN}
        settings = self.configured(case, **more)
        return importlib.import_module("gymnasium").make(named(case), cfg=settings, **options)

    def configured(self, case, **more):
        """Make the configuration of a task as it can be run here."""
        given = dict(case["kwargs"], **more)
        chosen = dict(CHOSEN, **{name: value for name, value in given.items() if name in CHOSEN})
        settings = importlib.import_module("isaaclab_tasks.utils").parse_env_cfg(named(case), **chosen)
        _here(settings, chosen["device"])
        settings.seed = case["seed"]
        return settings


class Task(World):
    """A task of Isaac Lab, driven by random actions within -1 and 1 where it bounds them no closer.

    `seconds` are those that making it took, then those of each step.
    """

    def __init__(self, raw, tell, seconds):
        import numpy as np

        task = raw.unwrapped
        space = task.single_action_space
        bounds = np.clip([space.low, space.high], -1, 1)
        super().__init__(tell, task.num_envs, *bounds)
        self.raw, self.task, self.seconds = raw, task, [seconds]
        self.torch = importlib.import_module("torch")

    def begin(self, seed):
        """Begin episodes in all worlds."""
        result = self.raw.reset() if seed is None else self.raw.reset(seed=seed)
        if not isinstance(result, tuple) or len(result) != 2:
            violate("call.result", call="reset()", got=shown(result), promised="(observation, info)")
        return self._observed("reset()", result[0])

    def step(self, action):
        """Make one step of all worlds: no end for the loop, since a world whose episode has ended begins the next one.

        What a step says of ends is part of the observation.
        """
        chosen = self.torch.as_tensor(action, device=self.task.device)
        began = monotonic()
        with library:
            result = self.raw.step(chosen)
        self.seconds.append(monotonic() - began)
        if not isinstance(result, tuple) or len(result) != 5:
            violate("call.result", call="step()", got=shown(result), promised="five values")
        observation = self._observed("step()", result[0])
        finite(observation, place("an observation", "step()"))
        reward, terminated, truncated = [
            self._array(value, name) for value, name in zip(result[1:], ("a reward", "terminated", "truncated"))
        ]
        scalar(reward, place("a reward", "step()"), self.shape)
        for name, ended in (("terminated", terminated), ("truncated", truncated)):
            flag(name, ended, self.tell, self.shape)
            observation[name] = ended
        return observation, reward, False, False

    def _observed(self, call, value):
        """Copy the parts of an observation, each as its space of one world says, for every world."""
        spaces = self.task.single_observation_space.spaces
        if not isinstance(value, dict) or set(value) != set(spaces):
            promised = "a dict of {}".format(", ".join(sorted(spaces)))
            violate("call.observation", call=call, got=shown(value), promised=promised)
        whole = self.task.observation_space
        if not hasattr(whole, "spaces"):
            self.tell("space", "isaaclab.observation_space", got=type(whole).__name__)
        arrays = {}
        for name, part in value.items():
            where, promised = place("observation {!r}".format(name)), spaces[name].dtype
            arrays[name] = self.seen(where, self._array(part, name), spaces[name].shape)
            if arrays[name].dtype != promised:
                got = str(arrays[name].dtype)
                self.tell("type", "value.dtype", where=where, got=got, promise="space", promised=str(promised))
        return arrays

    def _array(self, value, name):
        """Return the values of a tensor that lies where the task computes."""
        if not isinstance(value, self.torch.Tensor):
            violate("isaaclab.not_tensor", where=place(name), got=shown(value))
        if value.device != self.torch.device(self.task.device):
            violate("isaaclab.device", where=place(name), got=str(value.device), promised=str(self.task.device))
        return value.detach().cpu().numpy().copy()

    def draw(self):
        """Return the picture of a camera in the first world."""
        outputs = [sensor.data.output for sensor in self.task.scene.sensors.values() if hasattr(sensor.data, "output")]
        pictures = next(output[COLOURS] for output in outputs if COLOURS in output)
        return getattr(pictures, "torch", pictures)[0].cpu().numpy()

    def get_state(self):
        """Return the state of the scene."""
        with library:
            return self.task.scene.get_state(is_relative=True)

    def set_state(self, state):
        """Put the scene into a state."""
        with library:
            self.task.scene.reset_to(state, is_relative=True)
            self.task.sim.forward()

    def describe(self):
        """Return the device, the spaces and the physics; once it was driven, how long that took."""
        with library:
            names = ("single_observation_space", "single_action_space", "observation_space", "action_space")
            facts = {name: str(getattr(self.task, name))[:500] for name in names}
            facts.update(device=str(self.task.device), worlds=self.task.num_envs)
            physics = self.task.cfg.sim.physics
            facts["physics"] = type(getattr(physics, "solver_cfg", physics)).__name__
        if len(self.seconds) > 2:
            made, first, others = self.seconds[0], self.seconds[1], self.seconds[2:]
            took = {"making": made, "first_step": first, "step": sum(others) / len(others)}
            facts["told"] = dict(facts, seconds={name: round(value, 4) for name, value in took.items()})
        return facts

    def close(self):
        """Close it."""
        self.raw.close()


def _here(settings, device):
    """Change what a task's configuration takes from NVIDIA's servers or a GPU, where something here can stand in.

    The ground is a picture from there, and the cart and pole never touch it.
    """
    import tempfile

    folder = tempfile.gettempdir()
    for name, part in vars(settings.scene).items():
        stood_in(getattr(part, "spawn", None), folder)
        if type(getattr(part, "spawn", None)).__name__ == "GroundPlaneCfg":
            setattr(settings.scene, name, None)
    if device == "cpu" and hasattr(settings.sim.physics, "use_cuda_graph"):
        settings.sim.physics.use_cuda_graph = False


API = IsaacLab()

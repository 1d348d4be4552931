"""The adapter of Isaac Lab 3, which needs no Isaac Sim: `isaaclab:Isaac-Cartpole` is a task under Newton on a CPU.

An environment of Isaac Lab is always a batch, of torch tensors: `kwargs.num_envs` worlds, whose next episodes begin
by themselves. A robot that lies on NVIDIA's servers and no file here stands in for has to be fetched from there.
"""

import importlib

from .cell_cartpole import stood_in
from .cell_errors import Skip, library, violate
from .cell_scene import named
from .cell_values import finite, flag, scalar, shown
from .cell_worlds import World, Worlds

WORLDS = 4


class IsaacLab(Worlds):
    """The calls of a user: the task's configuration, for the CPU and so many worlds, and gymnasium's make."""

    name = "Isaac Lab"
    imports = ("isaaclab", "isaaclab_tasks")

    def make(self, case, tell, draw=False):
        """Make the environment of a case."""
        if draw:
            message = "Isaac Lab 3 draws with cameras in its scenes: render() gives no array"
            raise Skip(message)
        return self.simulate(case, tell)

    def simulate(self, case, tell, worlds=None):
        """Make a task, of this many worlds where it is asked for them."""
        more = {} if worlds is None else {"num_envs": worlds}
        with library:
            raw = self.bare(case, **more)
        return Task(raw, tell)

    def bare(self, case, **more):
        """Make the library's own object; only one may be open at a time in a process."""
        options = dict({"num_envs": WORLDS, "device": "cpu"}, **dict(case["kwargs"], **more))
        number, device = options.pop("num_envs"), options.pop("device")
        utils = importlib.import_module("isaaclab_tasks.utils")
        settings = utils.parse_env_cfg(named(case), device=device, num_envs=number)
        _here(settings, device)
        settings.seed = case["seed"]
        return importlib.import_module("gymnasium").make(named(case), cfg=settings, **options)


class Task(World):
    """A task of Isaac Lab, driven by random actions within -1 and 1 where it bounds them no closer."""

    def __init__(self, raw, tell):
        import numpy as np

        task = raw.unwrapped
        space = task.single_action_space
        bounds = np.clip([space.low, space.high], -1, 1)
        super().__init__(tell, task.num_envs, *bounds)
        self.raw, self.task = raw, task
        self.torch = importlib.import_module("torch")

    def begin(self, seed):
        """Begin episodes in all worlds."""
        result = self.raw.reset() if seed is None else self.raw.reset(seed=seed)
        if not isinstance(result, tuple) or len(result) != 2:
            violate("reset() returned {}, not (observation, info)", shown(result))
        return self._observed("reset()", result[0])

    def step(self, action):
        """Make one step of all worlds: no end for the loop, since a world whose episode has ended begins the next one.

        What a step says of ends is part of the observation.
        """
        with library:
            result = self.raw.step(self.torch.as_tensor(action, device=self.task.device))
        if not isinstance(result, tuple) or len(result) != 5:
            violate("step() returned {}, not five values", shown(result))
        observation = self._observed("step()", result[0])
        finite(observation, "step() returned an observation that")
        reward, terminated, truncated = [
            self._array(value, name) for value, name in zip(result[1:], ("a reward", "terminated", "truncated"))
        ]
        scalar(reward, "step() returned a reward", self.shape)
        for name, ended in (("terminated", terminated), ("truncated", truncated)):
            flag(name, ended, self.tell, self.shape)
            observation[name] = ended
        return observation, reward, False, False

    def _observed(self, call, value):
        """Copy the parts of an observation, each as its space of one world says, for every world."""
        spaces = self.task.single_observation_space.spaces
        if not isinstance(value, dict) or set(value) != set(spaces):
            violate("{} returned {} as observation, not a dict of {}", call, shown(value), ", ".join(sorted(spaces)))
        whole = self.task.observation_space
        if not hasattr(whole, "spaces"):
            text = "observations are dicts of tensors, and observation_space is a {}: single_observation_space fits"
            self.tell("space", text.format(type(whole).__name__))
        arrays = {}
        for name, part in value.items():
            arrays[name] = self.seen("observation {!r}".format(name), self._array(part, name), spaces[name].shape)
            if arrays[name].dtype != spaces[name].dtype:
                text = "observation {!r} has dtype {}, its space {}"
                self.tell("type", text.format(name, arrays[name].dtype, spaces[name].dtype))
        return arrays

    def _array(self, value, name):
        """The values of a tensor that lies where the task computes."""
        if not isinstance(value, self.torch.Tensor):
            violate("{} is {}, not a tensor of torch", name, shown(value))
        if value.device != self.torch.device(self.task.device):
            violate("{} is on the device {}, the task on {}", name, value.device, self.task.device)
        return value.detach().cpu().numpy().copy()

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
        """The device, the physics, and the spaces."""
        with library:
            names = ("single_observation_space", "single_action_space", "observation_space", "action_space")
            told = {name: str(getattr(self.task, name))[:500] for name in names}
            physics = type(self.task.cfg.sim.physics).__name__
            return dict(told, device=str(self.task.device), physics=physics, worlds=self.task.num_envs)

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

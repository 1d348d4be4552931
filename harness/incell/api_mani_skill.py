"""Drive ManiSkill, whose values are torch tensors of one world or more: `mani_skill:PickCube-v1` is a task on a CPU.

An environment of ManiSkill is always a batch, and on a CPU it is a batch of one world. The case's `kwargs` are those of
`gymnasium.make`; its defaults here are the state as observation and PhysX on the CPU.
"""

import importlib

from .cell_adapter import Adapter
from .cell_batched_worlds import TensorWorlds
from .cell_callables import local_name
from .cell_errors import library, violate
from .cell_values import describe_value

PACKAGES = {"mani-skill": "mani_skill"}
IDS = r"[A-Z]\w*-v\d+"
EXAMPLE = "mani_skill:PickCube-v1"
NATIVE_ERRORS = (r"\[[\d: .-]+\] \[(?:svulkan2|SAPIEN)\] \[(?:error|critical)\] .+",)

CHOSEN = {"num_envs": 1, "obs_mode": "state", "sim_backend": "physx_cpu"}
"""Arguments of `gymnasium.make`, with what they are where a case does not say."""


class ManiSkill(Adapter):
    """The calls of a user: gymnasium's make for one of the tasks that `mani_skill.envs` registers."""

    imports = ("gymnasium", "mani_skill.envs")

    def environment_names(self):
        """Return the tasks that ManiSkill has registered."""
        return sorted(importlib.import_module("mani_skill.utils.registration").REGISTERED_ENVS)

    def make(self, case, report, draw=False):
        """Make a task of one world, one that draws if requested; ManiSkill has several on a GPU alone."""
        with library:
            raw = self.make_raw(case, **({"render_mode": "rgb_array"} if draw else {}))
        return Task(raw, report)

    def make_raw(self, case, **more):
        """Make the library's own object."""
        options = dict(CHOSEN, **dict(case["kwargs"], **more))
        return importlib.import_module("gymnasium").make(local_name(case), **options)


class Task(TensorWorlds):
    """A task of ManiSkill, driven by random actions within its space."""

    def __init__(self, raw, report):
        task = raw.unwrapped
        super().__init__(raw, task, report, task.single_action_space.low, task.single_action_space.high)

    def as_array(self, where, tensor):
        """Return the values of a tensor, which has to lie where the task computes, as a numpy array."""
        if not isinstance(tensor, self.torch.Tensor):
            violate("value.as_other", where=where, got=describe_value(tensor), promised="a tensor")
        if tensor.device != self.torch.device(self.task.device):
            violate("tensor.device", where=where, got=str(tensor.device), promised=str(self.task.device))
        return tensor.detach().cpu().numpy().copy()

    def compare(self, where, array, space):
        """Report another dtype than that of the space."""
        if array.dtype != space.dtype:
            self.report("type", "tensor.dtype", where=where, got=str(array.dtype), promised=str(space.dtype))

    def draw(self):
        """Return the picture of the first world."""
        return self.raw.render()[0].cpu().numpy()

    def get_state(self):
        """Return the state of the scene: poses and velocities of all bodies."""
        with library:
            return self.task.get_state()

    def set_state(self, state):
        """Put the scene into a state."""
        with library:
            self.task.set_state(state)


API = ManiSkill()

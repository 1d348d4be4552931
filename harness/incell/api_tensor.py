"""The adapter of environments that speak torch tensors, many worlds at once: `tensor:module:callable`.

They have gymnasium's calls, and a first dimension of `num_envs` worlds in whatever goes in and out; the next episode
of a world begins by itself.
"""

import importlib

from .cell_adapter import Adapter
from .cell_errors import Skip, library, violate
from .cell_own import own
from .cell_values import finite, flag, scalar, shown
from .cell_worlds import World

FIVE = ("observation", "reward", "terminated", "truncated", "info")


class Tensors(Adapter):
    """A user's callable that makes an environment; it is given the case's `kwargs`."""

    imports = ("torch", "gymnasium")

    def modules(self, case):
        """Torch, gymnasium, and the module of the callable."""
        found = own(case)
        return [*self.imports, *([found.module] if found else [])]

    def knows(self, case):
        """Whether it is a callable."""
        found = own(case)
        return found is not None and found.exists()

    def make(self, case, tell, draw=False):
        """Make the environment of a case."""
        if draw:
            message = "it draws no pictures"
            raise Skip(message)
        with library:
            raw = self.bare(case)
        return Batch(raw, tell)

    def bare(self, case, **more):
        """Make the user's own object."""
        found = own(case)
        if found is None or not found.exists():
            violate("{} is no callable: name one as tensor:module:callable", case["env"])
        return found.make(dict(case["kwargs"], **more))


class Batch(World):
    """All worlds of an environment, driven by random actions.

    No step is the end for a loop, since a world whose episode has ended begins the next one; what a step says of ends
    is part of the observation.
    """

    def __init__(self, raw, tell):
        with library:
            space, number = raw.single_action_space, raw.num_envs
        super().__init__(tell, number, space.low, space.high)
        self.raw = raw
        self.torch = importlib.import_module("torch")

    def begin(self, seed):
        """Begin episodes in all worlds."""
        result = self.raw.reset() if seed is None else self.raw.reset(seed=seed)
        if not isinstance(result, tuple) or len(result) != 2:
            violate("reset() returned {}, not (observation, info)", shown(result))
        return self._observed("reset()", result[0])

    def step(self, action):
        """Make one step of all worlds."""
        with library:
            result = self.raw.step(self.torch.as_tensor(action, device=self.raw.device))
        if not isinstance(result, tuple) or len(result) != len(FIVE):
            violate("step() returned {}, not ({})", shown(result), ", ".join(FIVE))
        seen = self._observed("step()", result[0])
        told = zip(FIVE[1:4], result[1:4])
        reward, *ends = [self._array("step() returned {}".format(name), value) for name, value in told]
        scalar(reward, "step() returned a reward", self.shape)
        for name, ended in zip(FIVE[2:4], ends):
            flag(name, ended, self.tell, self.shape)
            seen[name] = ended
        for name, part in seen.items():
            finite(part, "step() returned {} that".format(name))
        return seen, reward, False, False

    def _observed(self, call, value):
        """Copy an observation, or the parts of one, each as its space of one world says, for every world."""
        space = self.raw.single_observation_space
        spaces = getattr(space, "spaces", None)
        if spaces is None:
            value, spaces = {"observation": value}, {"observation": space}
        if not isinstance(value, dict) or set(value) != set(spaces):
            violate("{} returned {} as observation, not a dict of {}", call, shown(value), ", ".join(sorted(spaces)))
        seen = {}
        for name, part in value.items():
            where = "{} returned the observation {!r}".format(call, name)
            seen[name] = self.seen(where, self._array(where, part), spaces[name].shape)
            if seen[name].dtype != spaces[name].dtype:
                self.tell("type", "{} with dtype {}, its space {}".format(where, seen[name].dtype, spaces[name].dtype))
            if not (seen[name] >= spaces[name].low).all() or not (seen[name] <= spaces[name].high).all():
                self.tell("space", "{} outside its space".format(where))
        return seen

    def _array(self, where, value):
        """The values of a tensor that lies where the environment computes."""
        if not isinstance(value, self.torch.Tensor):
            violate("{} as {}, not as a tensor", where, shown(value))
        if value.device != self.torch.device(self.raw.device):
            violate("{} on the device {}, the environment is on {}", where, value.device, self.raw.device)
        return value.detach().cpu().numpy().copy()

    def describe(self):
        """The device, the worlds, and the spaces."""
        with library:
            names = ("single_observation_space", "single_action_space")
            told = {name: str(getattr(self.raw, name))[:500] for name in names}
            return dict(told, device=str(self.raw.device), worlds=self.raw.num_envs)

    def close(self):
        """Close it."""
        self.raw.close()


API = Tensors()

"""The adapter of environments that speak torch tensors, many worlds at once: `tensor:module:callable`.

They have gymnasium's calls, and a first dimension of `num_envs` worlds in whatever goes in and out; the next episode
of a world begins by itself.
"""

import importlib

from .cell_adapter import Adapter
from .cell_errors import library, skip, violate
from .cell_observed import place
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
        """Return whether it is a callable."""
        found = own(case)
        return found is not None and found.exists()

    def make(self, case, tell, draw=False):
        """Make the environment of a case."""
        if draw:
            skip("tensor.no_pictures")
        with library:
            raw = self.bare(case)
        return Batch(raw, tell)

    def bare(self, case, **more):
        """Make the user's own object."""
        found = own(case)
        if found is None or not found.exists():
            violate("tensor.not_callable", got=case["env"])
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
            violate("call.result", call="reset()", got=shown(result), promised="(observation, info)")
        return self._observed("reset()", result[0])

    def step(self, action):
        """Make one step of all worlds."""
        with library:
            result = self.raw.step(self.torch.as_tensor(action, device=self.raw.device))
        if not isinstance(result, tuple) or len(result) != len(FIVE):
            violate("call.result", call="step()", got=shown(result), promised="({})".format(", ".join(FIVE)))
        seen = self._observed("step()", result[0])
        told = zip(FIVE[1:4], result[1:4])
        reward, *ends = [self._array(place(name, "step()"), value) for name, value in told]
        scalar(reward, place("a reward", "step()"), self.shape)
        for name, ended in zip(FIVE[2:4], ends):
            flag(name, ended, self.tell, self.shape)
            seen[name] = ended
        for name, part in seen.items():
            finite(part, place(name, "step()"))
        return seen, reward, False, False

    def _observed(self, call, value):
        """Copy an observation, or the parts of one, each as its space of one world says, for every world."""
        space = self.raw.single_observation_space
        spaces = getattr(space, "spaces", None)
        if spaces is None:
            value, spaces = {"observation": value}, {"observation": space}
        if not isinstance(value, dict) or set(value) != set(spaces):
            promised = "a dict of {}".format(", ".join(sorted(spaces)))
            violate("call.observation", call=call, got=shown(value), promised=promised)
        seen = {}
        for name, part in value.items():
            where, promised = place("the observation {!r}".format(name), call), spaces[name].dtype
            seen[name] = self.seen(where, self._array(where, part), spaces[name].shape)
            if seen[name].dtype != promised:
                self.tell("type", "tensor.dtype", where=where, got=str(seen[name].dtype), promised=str(promised))
            if not (seen[name] >= spaces[name].low).all() or not (seen[name] <= spaces[name].high).all():
                self.tell("space", "tensor.outside", where=where)
        return seen

    def _array(self, where, value):
        """Return the values of a tensor that lies where the environment computes."""
        if not isinstance(value, self.torch.Tensor):
            violate("value.as_other", where=where, got=shown(value), promised="a tensor")
        if value.device != self.torch.device(self.raw.device):
            violate("tensor.device", where=where, got=str(value.device), promised=str(self.raw.device))
        return value.detach().cpu().numpy().copy()

    def describe(self):
        """Return the device, the worlds, and the spaces."""
        with library:
            names = ("single_observation_space", "single_action_space")
            told = {name: str(getattr(self.raw, name))[:500] for name in names}
            return dict(told, device=str(self.raw.device), worlds=self.raw.num_envs)

    def close(self):
        """Close it."""
        self.raw.close()


API = Tensors()

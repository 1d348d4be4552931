"""Drive simulators that step one world or many at once, and whose values are arrays of another library than numpy."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import as_numbers, check_finite, check_flag, check_number, describe_value


class WorldsAdapter(Adapter):
    """Several environments are several worlds of one simulation, as users of these simulators have them."""

    name = "it"

    def make(self, case, report, draw=False):
        """Make a simulation of one world."""
        if draw:
            skip("worlds.no_pictures", name=self.name)
        return self.simulate(case, report)

    def make_vector(self, makers, options, report):
        """Make one simulation with a world for each maker; there are no workers."""
        if options is not None:
            skip("worlds.no_workers", name=self.name)
        return self.simulate(makers[0].case, report, len(makers))

    def simulate(self, case, report, worlds=None):
        """Make a simulation of one world, or of several as one: a `Worlds`."""
        raise NotImplementedError


class Worlds(Environment):
    """A simulation with random actions between `low` and `high`, without reward or end.

    `shape` is () for one world and (n,) for several, which come first in the shapes of all arrays.
    """

    def __init__(self, report, worlds, low, high):
        super().__init__(report)
        self.shape = () if worlds is None else (worlds,)
        self.low, self.high = low, high

    def copy_array(self, where, value, shape):
        """Copy an array of the library as numpy sees it: floating-point numbers of this shape for each world."""
        array, promised = as_numbers(value, where), self.shape + tuple(shape)
        if array.dtype.kind != "f":
            violate("worlds.not_floats", where=where, got=str(array.dtype))
        if array.shape != promised:
            violate("worlds.shape", where=where, got=str(array.shape), promised=str(promised))
        return array.copy()

    def complete_step(self, observation):
        """Return the result of a step with this observation, without reward or end."""
        import numpy as np

        never = np.zeros(self.shape, dtype=bool)
        return observation, np.zeros(self.shape), never, never

    def action(self):
        """Draw actions for all worlds: float32 of shape (worlds, size), or (size,) for one world."""
        actions = self.random.uniform(self.low, self.high, size=self.shape + self.low.shape)
        return actions.astype("float32")


class TensorWorlds(Worlds):
    """All worlds of an environment that takes and gives torch tensors, with gymnasium's calls.

    `raw` is what is driven; `task` has its spaces and device. No step ends the loop, since a world whose episode has
    ended begins the next one; the flags that a step gives are part of the observation.
    """

    PARTS = ("observation", "reward", "terminated", "truncated", "info")

    def __init__(self, raw, task, report, low, high):
        super().__init__(report, task.num_envs, low, high)
        self.raw, self.task = raw, task
        self.torch = importlib.import_module("torch")

    def begin(self, seed):
        """Begin episodes in all worlds."""
        result = self.raw.reset() if seed is None else self.raw.reset(seed=seed)
        if not isinstance(result, tuple) or len(result) != 2:
            violate("call.result", call="reset()", got=describe_value(result), promised="(observation, info)")
        return self._observation("reset()", result[0])

    def step(self, action):
        """Make one step of all worlds."""
        tensor = self.torch.as_tensor(action, device=self.task.device)
        with library:
            result = self.call_step(tensor)
        if not isinstance(result, tuple) or len(result) != len(self.PARTS):
            promised = "({})".format(", ".join(self.PARTS))
            violate("call.result", call="step()", got=describe_value(result), promised=promised)
        observation = self._observation("step()", result[0])
        values = zip(self.PARTS[1:4], result[1:4])
        reward, *ends = [self.as_array(place(name, "step()"), value) for name, value in values]
        check_number(reward, place("a reward", "step()"), self.shape)
        for name, flags in zip(self.PARTS[2:4], ends):
            check_flag(name, flags, self.report, self.shape)
            observation[name] = flags
        for name, part in observation.items():
            check_finite(part, place(name, "step()"))
        return observation, reward, False, False

    def call_step(self, action):
        """Call the library's own step."""
        return self.raw.step(action)

    def _observation(self, call, value):
        """Copy an observation, or the parts of one, each as its space of one world promises, for every world."""
        space = self.task.single_observation_space
        spaces = getattr(space, "spaces", None)
        if spaces is None:
            value, spaces = {"observation": value}, {"observation": space}
        if not isinstance(value, dict) or set(value) != set(spaces):
            promised = "a dict of {}".format(", ".join(sorted(spaces)))
            violate("call.observation", call=call, got=describe_value(value), promised=promised)
        arrays = {}
        for name, part in value.items():
            where = place("the observation {!r}".format(name), call)
            arrays[name] = self.copy_array(where, self.as_array(where, part), spaces[name].shape)
            self.compare(where, arrays[name], spaces[name])
        return arrays

    def as_array(self, where, tensor):
        """Return the values of a tensor, which has to lie where the environment computes, as a numpy array."""
        raise NotImplementedError

    def compare(self, where, array, space):
        """Report how one part of an observation differs from its space."""
        raise NotImplementedError

    def describe(self):
        """Return the spaces of one world, the device and the number of worlds."""
        with library:
            names = ("single_observation_space", "single_action_space")
            facts = {name: str(getattr(self.task, name))[:500] for name in names}
            return dict(facts, device=str(self.task.device), worlds=self.task.num_envs)

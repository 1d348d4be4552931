"""Drive EnvPool by its own `make`: `envpool:CartPole-v1`. One pool holds all environments; `kwargs` are make's."""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name
from .cell_errors import library, skip, violate
from .cell_observation import place
from .cell_values import as_numbers, check_finite, check_flag, check_number, describe_value

PACKAGES = {"envpool": "envpool"}
IDS = r"[A-Za-z][A-Za-z0-9]*-v[0-9]+"
EXAMPLE = "envpool:CartPole-v1"


class EnvPool(Adapter):
    """The calls of a user: `make` with a number of environments and a seed, `reset` and `step` of all of them."""

    imports = ("envpool",)

    def environment_names(self):
        """Return the names of all tasks."""
        return [str(name) for name in importlib.import_module("envpool").list_all_envs()]

    def make(self, case, report, draw=False):
        """Make a pool of one environment."""
        if draw:
            skip("worlds.no_pictures", name="EnvPool")
        return Pool(case, report, 1)

    def make_vector(self, makers, options, report):
        """Make a pool of several environments; its threads are no workers of Python."""
        if options is not None:
            skip("worlds.no_workers", name="EnvPool")
        return Pool(makers[0].case, report, len(makers))


class Pool(Environment):
    """A batch from the start. Environments whose episode has ended begin the next one by themselves."""

    def __init__(self, case, report, number):
        super().__init__(report)
        self.shape = (number,)
        self.options = dict({"env_type": "gymnasium"}, **case["kwargs"])
        self.name = local_name(case)
        self._open({"seed": case["seed"]})

    def _open(self, more):
        """Make the pool. It takes its seed here and nowhere else."""
        make = importlib.import_module("envpool").make
        with library:
            self.raw = make(self.name, num_envs=self.shape[0], **dict(self.options, **more))
            self.observations, self.actions = self.raw.observation_space, self.raw.action_space

    def begin(self, seed):
        """Begin episodes in all environments; for a seed in a new pool."""
        if seed is not None:
            self.close()
            self._open({"seed": seed})
        result = self.raw.reset()
        if not isinstance(result, tuple) or len(result) != 2:
            violate("call.result", call="reset()", got=describe_value(result), promised="(observation, info)")
        return self._observation("reset()", result[0])

    def step(self, action):
        """Make one step of all environments; no step ends the loop, and the flags are part of the observation."""
        with library:
            result = self.raw.step(action)
        if not isinstance(result, tuple) or len(result) != 5:
            promised = "(observation, reward, terminated, truncated, info)"
            violate("call.result", call="step()", got=describe_value(result), promised=promised)
        observation = self._observation("step()", result[0])
        check_finite(observation, place("an observation", "step()"))
        check_number(result[1], place("a reward", "step()"), self.shape)
        for name, flags in zip(("terminated", "truncated"), result[2:4]):
            check_flag(name, flags, self.report, self.shape)
            observation[name] = flags.copy()
        return observation, result[1].copy(), False, False

    def _observation(self, call, value):
        """Copy an observation, or its parts; each has the shape and type of its space, for every environment."""
        spaces = getattr(self.observations, "spaces", None)
        if spaces is None:
            value, spaces = {"observation": value}, {"observation": self.observations}
        if not isinstance(value, dict) or set(value) != set(spaces):
            promised = "a dict of {}".format(", ".join(sorted(spaces)))
            violate("call.observation", call=call, got=describe_value(value), promised=promised)
        arrays = {}
        for name, part in value.items():
            where = place("the observation {!r}".format(name), call)
            array, promised = as_numbers(part, where), self.shape + tuple(spaces[name].shape)
            if array.shape != promised:
                violate("worlds.shape", where=where, got=str(array.shape), promised=str(promised))
            # Arrays that a module built for NumPy 1 makes beside NumPy 2 show their first number everywhere.
            if any(size > 1 and not stride for size, stride in zip(array.shape, array.strides)):
                violate("envpool.strides", where=where, got=str(array.strides), promised=str(promised))
            if array.dtype != spaces[name].dtype:
                violate("envpool.type", where=where, got=str(array.dtype), promised=str(spaces[name].dtype))
            arrays[name] = array.copy()
        return arrays

    def action(self):
        """Draw one action for each environment."""
        number = getattr(self.actions, "n", None)
        if number is not None:
            return self.random.randint(int(number), size=self.shape).astype("int32")
        size = self.shape + tuple(self.actions.shape)
        return self.random.uniform(self.actions.low, self.actions.high, size=size).astype(self.actions.dtype)

    def close(self):
        """Let the pool go, which ends its threads."""
        self.raw = None

    def describe(self):
        """Return the spaces of one environment, and how many there are."""
        names = {"observation_space": self.observations, "action_space": self.actions}
        return dict({name: str(space)[:500] for name, space in names.items()}, environments=self.shape[0])


API = EnvPool()

"""Compare the values that an environment returns with its spaces; numpy is imported late, see `cell_adapter`."""

from .cell_errors import library, violate
from .cell_observation import inside, place, remark


class Examiner:
    """Examine the values of one environment: raise where a user could not go on, report lesser things.

    `batch` is None for a single environment, else the number of them in a vector environment. `report` takes a
    kind (`type`, `space`), a code and data. Rewards follow the `reward_space` that an environment declares. Where both
    its spaces are tuples of one length, it has as many agents.
    """

    def __init__(self, spaces, env, report, batch=None):
        self.spaces = spaces
        self.report = report
        self.batch = batch
        with library:
            self.space = env.observation_space
            declared = getattr(env, "reward_space", None) or getattr(
                getattr(env, "unwrapped", None), "reward_space", None
            )
            self.reward_shape = tuple(getattr(declared, "shape", None) or ())
            self.agents = self._count_agents(env.action_space)
        self.reward_size = None
        """The number of values in the last reward."""

    def _count_agents(self, actions):
        """Return how many agents share an environment: the parts of both its spaces, 0 unless these are such tuples."""
        both = [getattr(space, "spaces", None) for space in (self.space, actions)]
        several = all(isinstance(space, self.spaces.Tuple) for space in (self.space, actions))
        return len(both[0]) if several and len(both[0]) == len(both[1]) else 0

    def arity(self, call, result, parts):
        """Examine how many values a call returned; `parts` are their names."""
        if not isinstance(result, tuple) or len(result) != len(parts):
            violate("call.result", call=call, got=describe_value(result), promised="({})".format(", ".join(parts)))

    def info(self, call, info):
        """Examine an info, which is a dict."""
        if not isinstance(info, dict):
            violate("call.info", call=call, got=describe_value(info), promised="a dict")

    def observation(self, call, observation):
        """Examine an observation against its space."""
        remarks = []
        self._check(self.space, observation, place("an observation", call), remarks)
        for kind, code, data in remarks:
            self.report(kind, code, **data)
        with library:
            contained = bool(self.space.contains(observation))
        if not contained and not remarks:
            self.report("space", "space.outside", call=call, promised=_short(self.space))

    def _check(self, space, value, where, remarks):
        if isinstance(space, self.spaces.Dict):
            self._check_dict(space, value, where, remarks)
        elif isinstance(space, self.spaces.Tuple):
            self._check_tuple(space, value, where, remarks)
        elif isinstance(space, self.spaces.Box):
            check_array(value, space.shape, space.dtype, where, remarks, within=(space.low, space.high))
        elif isinstance(space, (self.spaces.MultiDiscrete, self.spaces.MultiBinary)):
            check_array(value, space.shape, space.dtype, where, remarks)
        elif isinstance(space, self.spaces.Discrete):
            _check_integer(value, where, remarks)
        else:
            check_finite(value, where)

    def _check_dict(self, space, value, where, remarks):
        if not hasattr(value, "keys"):
            violate("value.kind", where=where, got=describe_value(value), promised="a Dict")
        missing, extra = set(space.spaces) - set(value.keys()), set(value.keys()) - set(space.spaces)
        if missing:
            violate("value.keys_missing", where=where, missing=_quoted(missing), extra=_quoted(extra))
        if extra:
            remarks.append(remark("type", "value.keys_extra", where=where, extra=_quoted(extra)))
        for key, part in space.spaces.items():
            self._check(part, value[key], inside(where, key), remarks)

    def _check_tuple(self, space, value, where, remarks):
        if not isinstance(value, (tuple, list)):
            violate("value.kind", where=where, got=describe_value(value), promised="a Tuple")
        if len(value) != len(space.spaces):
            violate("value.parts", where=where, got=len(value), promised=len(space.spaces))
        if not isinstance(value, tuple):
            remarks.append(remark("type", "value.kind", where=where, got="a list", promised="a Tuple"))
        for number, (part, item) in enumerate(zip(space.spaces, value)):
            self._check(part, item, inside(where, number), remarks)

    def reward(self, reward):
        """Examine a reward, or a batch of them."""
        where = place("a reward", "step()")
        if self.batch is not None:
            check_number(reward, where, (self.batch,))
            return
        array = as_numbers(reward, where)
        self.reward_size = int(array.size)
        if array.shape != self.reward_shape:
            self._report_shape(where, array)
        _check_finite(array, where)

    def _report_shape(self, where, array):
        """Report a value of another shape that a loop can use: one number, or one of each agent."""
        if array.size == 1 and not self.reward_shape:
            self.report("type", "value.of_shape", where=where, got=str(array.shape), promised="a number")
        elif self.agents and array.shape == (self.agents,):
            self.report("type", "value.by_agent", where=where, agents=self.agents)
        else:
            violate("value.of_shape", where=where, got=str(array.shape), promised=str(self.reward_shape))

    def flag(self, name, value):
        """Examine a truth value, or a batch of them, and return it: of several agents, whether it holds for all."""
        if self.batch is None and self.agents and as_numbers(value, place(name)).shape == (self.agents,):
            check_flag(name, value, self.report, (self.agents,))
            self.report("type", "value.by_agent", where=place(name, "step()"), agents=self.agents)
            return all(value)
        check_flag(name, value, self.report, () if self.batch is None else (self.batch,))
        return value


def check_number(value, where, shape=()):
    """Examine a number, or numbers of this shape, which have to be finite."""
    array = as_numbers(value, where)
    if array.shape != shape:
        violate("value.of_shape", where=where, got=str(array.shape), promised=str(shape))
    _check_finite(array, where)


def check_flag(name, value, report, shape=()):
    """Examine a truth value, or several of this shape."""
    where = place(name, "step()")
    array = as_numbers(value, where)
    if array.shape != shape:
        violate("value.of_shape", where=where, got=str(array.shape), promised=str(shape))
    if array.dtype.kind != "b":
        if not bool(((array == 0) | (array == 1)).all()):
            violate("value.not_bool", where=where, got=_short(value))
        report("type", "value.as_other", where=where, got=describe_value(value), promised="bool")


def check_array(value, shape, dtype, where, remarks, promise="space", *, within=None):  # noqa: PLR0913 - of one promise
    """Examine an array of this shape and dtype, promised by a `promise`; lesser things are appended to `remarks`.

    Another dtype is a lesser thing where the promised one can hold the values; so is infinity `within` the bounds.
    """
    import numpy as np

    array = as_numbers(value, where)
    if array.shape != tuple(shape):
        violate("value.shape", where=where, got=str(array.shape), promise=promise, promised=str(tuple(shape)))
    if not isinstance(value, (np.ndarray, np.generic)):
        remarks.append(remark("type", "value.not_array", where=where, got=describe_value(value)))
    elif array.dtype != dtype:
        if not _can_hold(dtype, array):
            violate("value.dtype", where=where, got=str(array.dtype), promise=promise, promised=str(dtype))
        remarks.append(
            remark("type", "value.dtype", where=where, got=str(array.dtype), promise=promise, promised=str(dtype))
        )
    infinite = array.dtype.kind == "f" and within is not None and bool(np.isinf(array).any())
    if infinite and bool(((array >= within[0]) & (array <= within[1])).all()):
        remarks.append(remark("type", "value.infinite", where=where, promise=promise))
    else:
        _check_finite(array, where)


def _can_hold(dtype, array):
    """Return whether a dtype can hold these values, to the digits that it has."""
    import numpy as np

    if np.can_cast(array.dtype, dtype, "same_kind"):
        return True
    with np.errstate(all="ignore"):
        return bool((array.astype(dtype) == array).all())


def _check_integer(value, where, remarks):
    array = as_numbers(value, where)
    if array.size != 1 or array.dtype.kind not in "biu":
        violate("value.kind", where=where, got=describe_value(value), promised="Discrete")
    if array.shape != ():
        remarks.append(remark("type", "value.kind", where=where, got=describe_value(value), promised="Discrete"))


def check_finite(value, where):
    """Examine a value of which no one shape is promised (Sequence, Graph, OneOf): its numbers have to be finite."""
    import numpy as np

    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (tuple, list)):
        for item in value:
            check_finite(item, where)
    elif isinstance(value, (np.ndarray, np.generic, float)):
        _check_finite(np.asarray(value), where)


def as_numbers(value, where):
    """Return the value as an array of numbers or truth values."""
    import numpy as np

    try:
        with library:
            array = np.asarray(value)
    except Exception:  # reported below, without the chain of causes that points elsewhere
        array = None
    if array is None or array.dtype.kind not in "biufc":
        violate("value.not_numbers", where=where, got=describe_value(value))
    return array


def _check_finite(array, where):
    import numpy as np

    if array.dtype.kind in "fc" and not bool(np.isfinite(array).all()):
        count = int(array.size - np.isfinite(array).sum())
        violate("value.not_finite", where=where, got=count, size=int(array.size))


def describe_value(value):
    """Describe a value in words: its type, and an array's dtype and shape."""
    import numpy as np

    if isinstance(value, np.ndarray):
        return "an array of dtype {} and shape {}".format(value.dtype, value.shape)
    if isinstance(value, (tuple, list)):
        return "a {} of {}".format(type(value).__name__, len(value))
    if value is None:
        return "None"
    return "a {}".format(type(value).__name__)


def _short(value):
    """Return the text of a value, cut: a large Box prints all its bounds."""
    with library:
        text = " ".join(str(value).split())
    return text if len(text) <= 120 else text[:117] + "..."


def _quoted(keys):
    return ", ".join(sorted(repr(key) for key in keys)) or "none"

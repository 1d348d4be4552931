"""What an environment returned against what its spaces promise."""

import numpy as np

from .cell_errors import library, violate


class Examiner:
    """Looks at the values of one environment: raises where a user could not go on, tells of lesser things.

    `batch` is None for a single environment, else the number of them in a vector environment. `tell` takes a kind
    (`type`, `space`) and a text.
    """

    def __init__(self, spaces, env, tell, batch=None):
        self.spaces = spaces
        self.tell = tell
        self.batch = batch
        with library:
            self.space = env.observation_space

    def reset(self, result):
        """Examine what reset() returned, and return the observation."""
        if not isinstance(result, tuple) or len(result) != 2:
            violate("reset() returned {}, not (observation, info)", _shown(result))
        self._info("reset()", result[1])
        self._observation("reset()", result[0])
        return result[0]

    def step(self, result):
        """Examine what step() returned, and return (observation, reward, terminated, truncated)."""
        if not isinstance(result, tuple) or len(result) != 5:
            promised = "(observation, reward, terminated, truncated, info)"
            violate("step() returned {}, not {}", _shown(result), promised)
        observation, reward, terminated, truncated, info = result
        self._info("step()", info)
        self._observation("step()", observation)
        self._reward(reward)
        self._flag("terminated", terminated)
        self._flag("truncated", truncated)
        return observation, reward, terminated, truncated

    def _info(self, call, info):
        if not isinstance(info, dict):
            violate("{} returned {} as info, not a dict", call, _shown(info))

    def _observation(self, call, observation):
        told = []
        self._conform(self.space, observation, call + " returned an observation that", told)
        for text in told:
            self.tell("type", text)
        with library:
            inside = bool(self.space.contains(observation))
        if not inside and not told:
            self.tell("space", "{} returned an observation outside its space {}".format(call, _short(self.space)))

    def _conform(self, space, value, where, told):
        if isinstance(space, self.spaces.Dict):
            self._dict(space, value, where, told)
        elif isinstance(space, self.spaces.Tuple):
            self._tuple(space, value, where, told)
        elif isinstance(space, (self.spaces.Box, self.spaces.MultiDiscrete, self.spaces.MultiBinary)):
            _array(value, space.shape, space.dtype, where, told)
        elif isinstance(space, self.spaces.Discrete):
            _integer(value, where)
        else:
            _loose(value, where)

    def _dict(self, space, value, where, told):
        if not hasattr(value, "keys"):
            violate("{} is {}, its space a Dict", where, _shown(value))
        missing, extra = set(space.spaces) - set(value.keys()), set(value.keys()) - set(space.spaces)
        if missing or extra:
            text = "{} has not the keys of its space: missing {}, not in the space {}"
            violate(text, where, _names(missing), _names(extra))
        for key, part in space.spaces.items():
            self._conform(part, value[key], "{} at {!r}".format(where, key), told)

    def _tuple(self, space, value, where, told):
        if not isinstance(value, (tuple, list)):
            violate("{} is {}, its space a Tuple", where, _shown(value))
        if len(value) != len(space.spaces):
            violate("{} has {} parts, its space has {}", where, len(value), len(space.spaces))
        if not isinstance(value, tuple):
            told.append("{} is a list, its space a Tuple".format(where))
        for number, (part, item) in enumerate(zip(space.spaces, value)):
            self._conform(part, item, "{} at {}".format(where, number), told)

    def _reward(self, reward):
        shape = () if self.batch is None else (self.batch,)
        value = _numbers(reward, "step() returned a reward that")
        if value.shape != shape:
            violate("step() returned a reward of shape {}, not {}", value.shape, shape)
        _finite(value, "step() returned a reward that")

    def _flag(self, name, flag):
        shape = () if self.batch is None else (self.batch,)
        value = _numbers(flag, "step() returned {} that".format(name))
        if value.shape != shape:
            violate("step() returned {} of shape {}, not {}", name, value.shape, shape)
        if value.dtype.kind != "b":
            if not bool(np.all((value == 0) | (value == 1))):
                violate("step() returned {} = {}, not a bool", name, _short(flag))
            self.tell("type", "step() returned {} as {}, not as bool".format(name, _shown(flag)))


def _array(value, shape, dtype, where, told):
    array = _numbers(value, where)
    if array.shape != tuple(shape):
        violate("{} has shape {}, its space {}", where, array.shape, tuple(shape))
    if not isinstance(value, (np.ndarray, np.generic)):
        told.append("{} is {} where an array was promised".format(where, _shown(value)))
    elif array.dtype != dtype:
        if not np.can_cast(array.dtype, dtype):
            violate("{} has dtype {}, its space {}", where, array.dtype, dtype)
        told.append("{} has dtype {}, its space {}".format(where, array.dtype, dtype))
    _finite(array, where)


def _integer(value, where):
    array = _numbers(value, where)
    if array.shape != () or array.dtype.kind not in "biu":
        violate("{} is {}, its space Discrete", where, _shown(value))


def _loose(value, where):
    """Examine a value whose space promises no one shape (Sequence, Graph, OneOf): its numbers have to be finite."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (tuple, list)):
        for item in value:
            _loose(item, where)
    elif isinstance(value, (np.ndarray, np.generic, float)):
        _finite(np.asarray(value), where)


def _numbers(value, where):
    """Return the value as an array of numbers or truth values."""
    try:
        with library:
            array = np.asarray(value)
    except Exception:  # told below, without the chain of causes that points elsewhere
        array = None
    if array is None or array.dtype.kind not in "biufc":
        violate("{} is {}, not numbers", where, _shown(value))
    return array


def _finite(array, where):
    if array.dtype.kind in "fc" and not bool(np.isfinite(array).all()):
        count = int(array.size - np.isfinite(array).sum())
        violate("{} is not finite ({} of {} values)", where, count, array.size)


def _shown(value):
    """What kind of thing a value is, in words."""
    if isinstance(value, np.ndarray):
        return "an array of dtype {} and shape {}".format(value.dtype, value.shape)
    if isinstance(value, (tuple, list)):
        return "a {} of {}".format(type(value).__name__, len(value))
    if value is None:
        return "None"
    return "a {}".format(type(value).__name__)


def _short(value):
    """The text of a value, cut: a large Box prints all its bounds."""
    with library:
        text = " ".join(str(value).split())
    return text if len(text) <= 120 else text[:117] + "..."


def _names(keys):
    return ", ".join(sorted(repr(key) for key in keys)) or "none"

"""What an environment returned against what its spaces promise; numpy is imported late, see `cell_adapter`."""

from .cell_errors import library, violate


class Examiner:
    """Looks at the values of one environment: raises where a user could not go on, tells of lesser things.

    `batch` is None for a single environment, else the number of them in a vector environment. `tell` takes a kind
    (`type`, `space`) and a text. What the environment declares beside its spaces holds, too: rewards are as its
    `reward_space` says, and where both its spaces are tuples of one length, of as many agents.
    """

    def __init__(self, spaces, env, tell, batch=None):
        self.spaces = spaces
        self.tell = tell
        self.batch = batch
        with library:
            self.space = env.observation_space
            declared = getattr(env, "reward_space", None) or getattr(
                getattr(env, "unwrapped", None), "reward_space", None
            )
            self.reward_shape = tuple(getattr(declared, "shape", None) or ())
            self.agents = self._agents(env.action_space)
        self.rewards = None
        """The number of values of the last reward."""

    def _agents(self, actions):
        """Return how many agents share an environment: the parts of both its spaces, 0 unless these are such tuples."""
        both = [getattr(space, "spaces", None) for space in (self.space, actions)]
        several = all(isinstance(space, self.spaces.Tuple) for space in (self.space, actions))
        return len(both[0]) if several and len(both[0]) == len(both[1]) else 0

    def arity(self, call, result, parts):
        """Examine how many values a call returned; `parts` are their names."""
        if not isinstance(result, tuple) or len(result) != len(parts):
            violate("{} returned {}, not ({})", call, shown(result), ", ".join(parts))

    def info(self, call, info):
        """Examine an info, which is a dict."""
        if not isinstance(info, dict):
            violate("{} returned {} as info, not a dict", call, shown(info))

    def observation(self, call, observation):
        """Examine an observation against its space."""
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
        elif isinstance(space, self.spaces.Box):
            array_of(value, space.shape, space.dtype, where, told, within=(space.low, space.high))
        elif isinstance(space, (self.spaces.MultiDiscrete, self.spaces.MultiBinary)):
            array_of(value, space.shape, space.dtype, where, told)
        elif isinstance(space, self.spaces.Discrete):
            _integer(value, where, told)
        else:
            finite(value, where)

    def _dict(self, space, value, where, told):
        if not hasattr(value, "keys"):
            violate("{} is {}, its space a Dict", where, shown(value))
        missing, extra = set(space.spaces) - set(value.keys()), set(value.keys()) - set(space.spaces)
        if missing:
            text = "{} has not the keys of its space: missing {}, not in the space {}"
            violate(text, where, _names(missing), _names(extra))
        if extra:
            told.append("{} has keys that are not in its space: {}".format(where, _names(extra)))
        for key, part in space.spaces.items():
            self._conform(part, value[key], "{} at {!r}".format(where, key), told)

    def _tuple(self, space, value, where, told):
        if not isinstance(value, (tuple, list)):
            violate("{} is {}, its space a Tuple", where, shown(value))
        if len(value) != len(space.spaces):
            violate("{} has {} parts, its space has {}", where, len(value), len(space.spaces))
        if not isinstance(value, tuple):
            told.append("{} is a list, its space a Tuple".format(where))
        for number, (part, item) in enumerate(zip(space.spaces, value)):
            self._conform(part, item, "{} at {}".format(where, number), told)

    def reward(self, reward):
        """Examine a reward, or a batch of them."""
        where = "step() returned a reward"
        if self.batch is not None:
            scalar(reward, where, (self.batch,))
            return
        array = numbers(reward, where + " that")
        self.rewards = int(array.size)
        if array.shape != self.reward_shape:
            self._other_shape(where, array)
        _finite(array, where + " that")

    def _other_shape(self, what, array):
        """Tell of a value of another shape that a loop can use: one number, or one of each agent."""
        if array.size == 1 and not self.reward_shape:
            self.tell("type", "{} of shape {}, not a number".format(what, array.shape))
        elif self.agents and array.shape == (self.agents,):
            self.tell("type", "{} for each of its {} agents".format(what, self.agents))
        else:
            violate("{} of shape {}, not {}", what, array.shape, self.reward_shape)

    def flag(self, name, value):
        """Examine a truth value, or a batch of them, and return it: of several agents, whether it holds for all."""
        if self.batch is None and self.agents and numbers(value, name).shape == (self.agents,):
            flag(name, value, self.tell, (self.agents,))
            self.tell("type", "step() returned {} for each of its {} agents".format(name, self.agents))
            return all(value)
        flag(name, value, self.tell, () if self.batch is None else (self.batch,))
        return value


def scalar(value, where, shape=()):
    """Examine a number, or numbers of this shape: it has to be finite."""
    array = numbers(value, where + " that")
    if array.shape != shape:
        violate("{} of shape {}, not {}", where, array.shape, shape)
    _finite(array, where + " that")


def flag(name, value, tell, shape=()):
    """Examine a truth value, or several of this shape."""
    array = numbers(value, "step() returned {} that".format(name))
    if array.shape != shape:
        violate("step() returned {} of shape {}, not {}", name, array.shape, shape)
    if array.dtype.kind != "b":
        if not bool(((array == 0) | (array == 1)).all()):
            violate("step() returned {} = {}, not a bool", name, _short(value))
        tell("type", "step() returned {} as {}, not as bool".format(name, shown(value)))


def array_of(value, shape, dtype, where, told, promise="space", *, within=None):  # noqa: PLR0913 - of one promise
    """Examine an array of this shape and dtype, promised by a `promise`; lesser things are appended to `told`.

    Another dtype is one of them where the promised one can hold the values, and infinity where it lies `within` bounds.
    """
    import numpy as np

    array = numbers(value, where)
    if array.shape != tuple(shape):
        violate("{} has shape {}, its {} {}", where, array.shape, promise, tuple(shape))
    if not isinstance(value, (np.ndarray, np.generic)):
        told.append("{} is {} where an array was promised".format(where, shown(value)))
    elif array.dtype != dtype:
        if not _holds(dtype, array):
            violate("{} has dtype {}, its {} {}", where, array.dtype, promise, dtype)
        told.append("{} has dtype {}, its {} {}".format(where, array.dtype, promise, dtype))
    endless = array.dtype.kind == "f" and within is not None and bool(np.isinf(array).any())
    if endless and bool(((array >= within[0]) & (array <= within[1])).all()):
        told.append("{} is infinite, which its {} allows".format(where, promise))
    else:
        _finite(array, where)


def _holds(dtype, array):
    """Tell whether a dtype can hold these values, to the digits that it has."""
    import numpy as np

    if np.can_cast(array.dtype, dtype, "same_kind"):
        return True
    with np.errstate(all="ignore"):
        return bool((array.astype(dtype) == array).all())


def _integer(value, where, told):
    array = numbers(value, where)
    if array.size != 1 or array.dtype.kind not in "biu":
        violate("{} is {}, its space Discrete", where, shown(value))
    if array.shape != ():
        told.append("{} is {}, its space Discrete".format(where, shown(value)))


def finite(value, where):
    """Examine a value of which no one shape is promised (Sequence, Graph, OneOf): its numbers have to be finite."""
    import numpy as np

    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (tuple, list)):
        for item in value:
            finite(item, where)
    elif isinstance(value, (np.ndarray, np.generic, float)):
        _finite(np.asarray(value), where)


def numbers(value, where):
    """Return the value as an array of numbers or truth values."""
    import numpy as np

    try:
        with library:
            array = np.asarray(value)
    except Exception:  # told below, without the chain of causes that points elsewhere
        array = None
    if array is None or array.dtype.kind not in "biufc":
        violate("{} is {}, not numbers", where, shown(value))
    return array


def _finite(array, where):
    import numpy as np

    if array.dtype.kind in "fc" and not bool(np.isfinite(array).all()):
        count = int(array.size - np.isfinite(array).sum())
        violate("{} is not finite ({} of {} values)", where, count, array.size)


def shown(value):
    """What kind of thing a value is, in words."""
    import numpy as np

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

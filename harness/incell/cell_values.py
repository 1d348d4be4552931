"""What an environment returned against what its spaces promise; numpy is imported late, see `cell_adapter`."""

from .cell_errors import library, violate


class Examiner:
    """Looks at the values of one environment: raises where a user could not go on, tells of lesser things.

    `batch` is None for a single environment, else the number of them in a vector environment. `tell` takes a kind
    (`type`, `space`) and a text. `casting` is how another dtype than that of the space may be cast to it.
    """

    casting = "safe"

    def __init__(self, spaces, env, tell, batch=None):
        self.spaces = spaces
        self.tell = tell
        self.batch = batch
        with library:
            self.space = env.observation_space

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
        elif isinstance(space, (self.spaces.Box, self.spaces.MultiDiscrete, self.spaces.MultiBinary)):
            array_of(value, space.shape, space.dtype, where, told, casting=self.casting)
        elif isinstance(space, self.spaces.Discrete):
            _integer(value, where)
        else:
            finite(value, where)

    def _dict(self, space, value, where, told):
        if not hasattr(value, "keys"):
            violate("{} is {}, its space a Dict", where, shown(value))
        missing, extra = set(space.spaces) - set(value.keys()), set(value.keys()) - set(space.spaces)
        if missing or extra:
            text = "{} has not the keys of its space: missing {}, not in the space {}"
            violate(text, where, _names(missing), _names(extra))
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
        scalar(reward, "step() returned a reward", () if self.batch is None else (self.batch,))

    def flag(self, name, value):
        """Examine a truth value, or a batch of them."""
        flag(name, value, self.tell, () if self.batch is None else (self.batch,))


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


def array_of(value, shape, dtype, where, told, promise="space", *, casting="safe"):  # noqa: PLR0913 - of one promise
    """Examine an array of this shape and dtype, promised by a `promise`; lesser things are appended to `told`.

    Another dtype that can be cast in this way is one of them.
    """
    import numpy as np

    array = numbers(value, where)
    if array.shape != tuple(shape):
        violate("{} has shape {}, its {} {}", where, array.shape, promise, tuple(shape))
    if not isinstance(value, (np.ndarray, np.generic)):
        told.append("{} is {} where an array was promised".format(where, shown(value)))
    elif array.dtype != dtype:
        if not np.can_cast(array.dtype, dtype, casting):
            violate("{} has dtype {}, its {} {}", where, array.dtype, promise, dtype)
        told.append("{} has dtype {}, its {} {}".format(where, array.dtype, promise, dtype))
    _finite(array, where)


def _integer(value, where):
    array = numbers(value, where)
    if array.shape != () or array.dtype.kind not in "biu":
        violate("{} is {}, its space Discrete", where, shown(value))


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

"""Compare the values that an environment returns with its spaces; numpy is imported late, see `cell_adapter`."""

from .cell_errors import library, violate
from .cell_observed import inside, place, remark


class Examiner:
    """Looks at the values of one environment: raises where a user could not go on, tells of lesser things.

    `batch` is None for a single environment, else the number of them in a vector environment. `tell` takes a kind
    (`type`, `space`), a code and data. What the environment declares beside its spaces holds, too: rewards are as its
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
            violate("call.result", call=call, got=shown(result), promised="({})".format(", ".join(parts)))

    def info(self, call, info):
        """Examine an info, which is a dict."""
        if not isinstance(info, dict):
            violate("call.info", call=call, got=shown(info), promised="a dict")

    def observation(self, call, observation):
        """Examine an observation against its space."""
        told = []
        self._conform(self.space, observation, place("an observation", call), told)
        for kind, code, data in told:
            self.tell(kind, code, **data)
        with library:
            contained = bool(self.space.contains(observation))
        if not contained and not told:
            self.tell("space", "space.outside", call=call, promised=_short(self.space))

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
            violate("value.kind", where=where, got=shown(value), promised="a Dict")
        missing, extra = set(space.spaces) - set(value.keys()), set(value.keys()) - set(space.spaces)
        if missing:
            violate("value.keys_missing", where=where, missing=_names(missing), extra=_names(extra))
        if extra:
            told.append(remark("type", "value.keys_extra", where=where, extra=_names(extra)))
        for key, part in space.spaces.items():
            self._conform(part, value[key], inside(where, key), told)

    def _tuple(self, space, value, where, told):
        if not isinstance(value, (tuple, list)):
            violate("value.kind", where=where, got=shown(value), promised="a Tuple")
        if len(value) != len(space.spaces):
            violate("value.parts", where=where, got=len(value), promised=len(space.spaces))
        if not isinstance(value, tuple):
            told.append(remark("type", "value.kind", where=where, got="a list", promised="a Tuple"))
        for number, (part, item) in enumerate(zip(space.spaces, value)):
            self._conform(part, item, inside(where, number), told)

    def reward(self, reward):
        """Examine a reward, or a batch of them."""
        where = place("a reward", "step()")
        if self.batch is not None:
            scalar(reward, where, (self.batch,))
            return
        array = numbers(reward, where)
        self.rewards = int(array.size)
        if array.shape != self.reward_shape:
            self._other_shape(where, array)
        _finite(array, where)

    def _other_shape(self, where, array):
        """Tell of a value of another shape that a loop can use: one number, or one of each agent."""
        if array.size == 1 and not self.reward_shape:
            self.tell("type", "value.of_shape", where=where, got=str(array.shape), promised="a number")
        elif self.agents and array.shape == (self.agents,):
            self.tell("type", "value.by_agent", where=where, agents=self.agents)
        else:
            violate("value.of_shape", where=where, got=str(array.shape), promised=str(self.reward_shape))

    def flag(self, name, value):
        """Examine a truth value, or a batch of them, and return it: of several agents, whether it holds for all."""
        if self.batch is None and self.agents and numbers(value, place(name)).shape == (self.agents,):
            flag(name, value, self.tell, (self.agents,))
            self.tell("type", "value.by_agent", where=place(name, "step()"), agents=self.agents)
            return all(value)
        flag(name, value, self.tell, () if self.batch is None else (self.batch,))
        return value


def scalar(value, where, shape=()):
    """Examine a number, or numbers of this shape: it has to be finite."""
    array = numbers(value, where)
    if array.shape != shape:
        violate("value.of_shape", where=where, got=str(array.shape), promised=str(shape))
    _finite(array, where)


def flag(name, value, tell, shape=()):
    """Examine a truth value, or several of this shape."""
    where = place(name, "step()")
    array = numbers(value, where)
    if array.shape != shape:
        violate("value.of_shape", where=where, got=str(array.shape), promised=str(shape))
    if array.dtype.kind != "b":
        if not bool(((array == 0) | (array == 1)).all()):
            violate("value.not_bool", where=where, got=_short(value))
        tell("type", "value.as_other", where=where, got=shown(value), promised="bool")


def array_of(value, shape, dtype, where, told, promise="space", *, within=None):  # noqa: PLR0913 - of one promise
    """Examine an array of this shape and dtype, promised by a `promise`; lesser things are appended to `told`.

    Another dtype is one of them where the promised one can hold the values, and infinity where it lies `within` bounds.
    """
    import numpy as np

    array = numbers(value, where)
    if array.shape != tuple(shape):
        violate("value.shape", where=where, got=str(array.shape), promise=promise, promised=str(tuple(shape)))
    if not isinstance(value, (np.ndarray, np.generic)):
        told.append(remark("type", "value.not_array", where=where, got=shown(value)))
    elif array.dtype != dtype:
        if not _holds(dtype, array):
            violate("value.dtype", where=where, got=str(array.dtype), promise=promise, promised=str(dtype))
        told.append(
            remark("type", "value.dtype", where=where, got=str(array.dtype), promise=promise, promised=str(dtype))
        )
    endless = array.dtype.kind == "f" and within is not None and bool(np.isinf(array).any())
    if endless and bool(((array >= within[0]) & (array <= within[1])).all()):
        told.append(remark("type", "value.infinite", where=where, promise=promise))
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
        violate("value.kind", where=where, got=shown(value), promised="Discrete")
    if array.shape != ():
        told.append(remark("type", "value.kind", where=where, got=shown(value), promised="Discrete"))


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
        violate("value.not_numbers", where=where, got=shown(value))
    return array


def _finite(array, where):
    import numpy as np

    if array.dtype.kind in "fc" and not bool(np.isfinite(array).all()):
        count = int(array.size - np.isfinite(array).sum())
        violate("value.not_finite", where=where, got=count, size=int(array.size))


def shown(value):
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


def _names(keys):
    return ", ".join(sorted(repr(key) for key in keys)) or "none"

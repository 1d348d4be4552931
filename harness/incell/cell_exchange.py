"""Record the values, memory and resets that pass between an environment of arrays and the library that drives it.

An array is numpy's or torch's. A `part` is one array of what a step gives, by its name: `reward`, `terminated`,
`truncated`, `observation`, or one of the keys of an observation.
"""

from .cell_counting import Counts

ENDS = ("terminated", "truncated")
LAST = ("final_obs", "final_observation")
"""Where gymnasium's vector environments keep the observations with which episodes ended, since 1.0 and before."""


class Exchange:
    """Watches `step` and `reset` of an environment as long as it is entered.

    `steps` has a `Step` of each; `resets` says for each reset how many worlds were amid an episode and not spared by a
    mask. `counts` counts for the environment while that has the word; what is done here does not count.
    """

    def __init__(self, env):
        self.env = env
        self.counts = Counts()
        self.steps = []
        self.resets = []
        self.kept = {name: getattr(env, name) for name in ("step", "reset")}
        self.begun = None

    def __enter__(self):
        """Begin to watch."""
        self.env.step, self.env.reset = self._step, self._reset
        return self

    def __exit__(self, *_):
        """Let the environment be as it was."""
        for name in self.kept:
            delattr(self.env, name)

    def _step(self, action):
        with self.counts.at("environment"):
            result = self.kept["step"](action)
        with self.counts.at(None):
            step = Step(action, result)
            self.steps.append(step)
            self.begun = _number(~step.ended)
        return result

    def _reset(self, *values, **named):
        spares = any(name in (named.get("options") or {}) for name in ("reset_mask", "env_ids")) or "env_ids" in named
        self.resets.append(0 if spares else self.begun or 0)
        self.begun = None
        with self.counts.at("environment"):
            return self.kept["reset"](*values, **named)


class Step:
    """One step: the action and the result as they were passed, and a copy of each part as it was then.

    `last` has the observations with which episodes ended, where the environment tells them apart.
    """

    def __init__(self, action, result):
        self.action = action
        self.parts = parts_of(result)
        self.copies = {name: array_of(value).copy() for name, value in self.parts.items()}
        info = result[-1] if isinstance(result[-1], dict) else {}
        last = [info[name] for name in LAST if name in info][:1]
        self.last = {name: array_of(value).copy() for name, value in named(last[0]).items()} if last else {}
        found = [self.copies[name].astype(bool) for name in ENDS if name in self.copies]
        self.ended = found[0] | found[1] if len(found) == 2 else found[0]


def reuses(steps):
    """Return whether any part of what the last two steps gave lies in the same memory."""
    before, last = steps[-2:]
    return any(same_memory(last.parts[name], before.parts[name]) for name in last.parts)


def parts_of(result):
    """Return the parts of a result of step(), of five values or, in gym's older way, four."""
    names = ("reward",) + (ENDS if len(result) == 5 else ENDS[:1])
    return dict(named(result[0]), **dict(zip(names, result[1:-1])))


def named(observation):
    """Return the parts of an observation by name."""
    return dict(observation.items()) if hasattr(observation, "items") else {"observation": observation}


def array_of(value):
    """Return the values as an array of numpy, which may share the memory."""
    import numpy as np

    return value.detach().cpu().numpy() if hasattr(value, "detach") else np.asarray(value)


def address(value):
    """Return the memory address of an array; None for any other value."""
    import numpy as np

    if hasattr(value, "data_ptr"):
        return value.data_ptr()
    return value.__array_interface__["data"][0] if isinstance(value, np.ndarray) else None


def same_memory(one, two):
    """Return whether two arrays begin at one place; None where one of them is no array."""
    places = address(one), address(two)
    return None if None in places else places[0] == places[1]


def shown(value):
    """Describe an array as in `torch.Tensor float32 [4, 2] cpu`; of any other value name the type."""
    kind = type(value)
    name = kind.__name__ if kind.__module__ == "builtins" else "{}.{}".format(kind.__module__, kind.__qualname__)
    if not hasattr(value, "shape"):
        return name
    dtype, device = str(value.dtype).replace("torch.", ""), getattr(value, "device", None) or "cpu"
    return "{} {} {} {}".format(name, dtype, list(value.shape), device)


def equal(one, two):
    """Return whether two arrays hold the same values; a dimension of size one more or less is no difference."""
    import numpy as np

    left, right = array_of(one), array_of(two)
    return left.size == right.size and bool(np.array_equal(left.reshape(right.shape), right, equal_nan=_floats(left)))


def rows(array, which):
    """Return the values in those worlds that the mask `which` selects."""
    import numpy as np

    which = np.asarray(which).reshape(-1)
    return array_of(array).reshape(which.size, -1)[which]


def _floats(array):
    return array.dtype.kind in "fc"


def _number(flags):
    return int(flags.sum())

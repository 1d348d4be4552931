"""Record the values, memory and resets that pass between an environment of arrays and the library that drives it.

An array is numpy's or torch's. A `part` is one array of what a step gives, by its name: `reward`, `terminated`,
`truncated`, `observation`, or one of the keys of an observation.
"""

from .cell_copy_counts import Counts

ENDS = ("terminated", "truncated")
LAST = ("final_obs", "final_observation")
"""Where gymnasium's vector environments keep the observations with which episodes ended, since 1.0 and before."""


class StepRecorder:
    """Watch `step` and `reset` of an environment as long as it is entered.

    `steps` has a `RecordedStep` of each; `resets` counts for each reset the worlds that were amid an episode and not
    spared by a mask. `counts` counts for the environment while its methods run; what is done here does not count.
    """

    def __init__(self, env):
        self.env = env
        self.counts = Counts()
        self.steps = []
        self.resets = []
        self._originals = {name: getattr(env, name) for name in ("step", "reset")}
        self._running_worlds = None

    def __enter__(self):
        """Begin to watch."""
        self.env.step, self.env.reset = self._step, self._reset
        return self

    def __exit__(self, *_):
        """Give the environment its own methods back."""
        for name in self._originals:
            delattr(self.env, name)

    def _step(self, action):
        with self.counts.at("environment"):
            result = self._originals["step"](action)
        with self.counts.at(None):
            step = RecordedStep(action, result)
            self.steps.append(step)
            self._running_worlds = int((~step.ended).sum())
        return result

    def _reset(self, *values, **named):
        options = named.get("options") or {}
        spares = "reset_mask" in options or "env_ids" in options or "env_ids" in named
        self.resets.append(0 if spares else self._running_worlds or 0)
        self._running_worlds = None
        with self.counts.at("environment"):
            return self._originals["reset"](*values, **named)


class RecordedStep:
    """One step: the action and the result as they were passed, and a copy of each part as it was then.

    `last` has the observations with which episodes ended, where the environment tells them apart.
    """

    def __init__(self, action, result):
        self.action = action
        self.parts = parts_of(result)
        self.copies = {name: as_numpy(value).copy() for name, value in self.parts.items()}
        info = result[-1] if isinstance(result[-1], dict) else {}
        last = [info[name] for name in LAST if name in info][:1]
        self.last = {name: as_numpy(value).copy() for name, value in parts_by_name(last[0]).items()} if last else {}
        flags = [self.copies[name].astype(bool) for name in ENDS if name in self.copies]
        self.ended = flags[0] | flags[1] if len(flags) == 2 else flags[0]


def reuses_memory(steps):
    """Return whether any part of the last two steps is in the same memory."""
    before, last = steps[-2:]
    return any(same_memory(last.parts[name], before.parts[name]) for name in last.parts)


def parts_of(result):
    """Return the parts of a result of step(), which has five values or, in older gym, four."""
    names = ("reward",) + (ENDS if len(result) == 5 else ENDS[:1])
    return dict(parts_by_name(result[0]), **dict(zip(names, result[1:-1])))


def parts_by_name(observation):
    """Return the parts of an observation by name."""
    return dict(observation.items()) if hasattr(observation, "items") else {"observation": observation}


def as_numpy(value):
    """Return the values as an array of numpy, which may share the memory."""
    import numpy as np

    return value.detach().cpu().numpy() if hasattr(value, "detach") else np.asarray(value)


def address(value):
    """Return the memory address of an array; None for any other value."""
    import numpy as np

    if hasattr(value, "data_ptr"):
        return value.data_ptr()
    return value.__array_interface__["data"][0] if isinstance(value, np.ndarray) else None


def same_memory(first, second):
    """Return whether two arrays begin at one place; None where one of them is no array."""
    places = address(first), address(second)
    return None if None in places else places[0] == places[1]


def describe_array(value):
    """Describe an array as in `torch.Tensor float32 [4, 2] cpu`; of any other value name the type."""
    kind = type(value)
    name = kind.__name__ if kind.__module__ == "builtins" else "{}.{}".format(kind.__module__, kind.__qualname__)
    if not hasattr(value, "shape"):
        return name
    dtype, device = str(value.dtype).replace("torch.", ""), getattr(value, "device", None) or "cpu"
    return "{} {} {} {}".format(name, dtype, list(value.shape), device)


def same_values(first, second):
    """Return whether two arrays hold the same values; a dimension of size one more or less is no difference."""
    import numpy as np

    left, right = as_numpy(first), as_numpy(second)
    floats = left.dtype.kind in "fc"
    return left.size == right.size and bool(np.array_equal(left.reshape(right.shape), right, equal_nan=floats))


def rows(array, which):
    """Return the values in those worlds that the mask `which` selects."""
    import numpy as np

    which = np.asarray(which).reshape(-1)
    return as_numpy(array).reshape(which.size, -1)[which]

"""Read and set what the task of an environment remembers of its reset: goals, places of objects, an observation."""

import numpy as np

PLACES = ("body_pos", "body_quat", "site_pos")
"""Arrays of mjModel in which a reset places what cannot move: a door, a box, the mark of a goal."""

VIEWED = ("qpos", "qvel", "xpos", "xquat", "geom_xpos", "site_xpos", "mocap_pos", "mocap_quat")
"""Arrays of mjData that an attribute can be a view of; then it is no memory."""

RESETS = 5
"""Resets that show which places of the model are drawn."""


class TaskMemory:
    """Numbers outside of mjData that a reset sets: attributes of the environment, and places in the model.

    An attribute is one if the reset assigns another object to it. That depends on the code of the environment alone,
    so that each release of MuJoCo has the same ones.
    """

    def __init__(self, env, owners, model, data):
        self.data = data
        before = [dict(vars(owner)) for owner in owners]
        places = [self._places(env, model, seed) for seed in range(RESETS)]
        self.attributes = []
        for owner, old in zip(owners, before):
            for name, value in sorted(vars(owner).items()):
                if value is not old.get(name) and self._is_memory(value):
                    self.attributes.append((owner, name))
        self.rows = [
            (getattr(model, name), row)
            for name in PLACES
            for row in range(len(getattr(model, name)))
            if len({places[turn][name][row].tobytes() for turn in range(RESETS)}) > 1
        ]
        self.first = self.read()

    def __len__(self):
        """Return how many attributes and places there are."""
        return len(self.attributes) + len(self.rows)

    @staticmethod
    def _places(env, model, seed):
        env.reset(seed)
        return {name: np.array(getattr(model, name)) for name in PLACES}

    def _is_memory(self, value):
        if isinstance(value, np.ndarray):
            viewed = any(np.may_share_memory(value, getattr(self.data, name)) for name in VIEWED)
            return value.dtype.kind == "f" and value.size > 0 and not viewed
        return isinstance(value, (float, np.floating))

    def _values(self):
        yield from (getattr(owner, name) for owner, name in self.attributes)
        yield from (array[row] for array, row in self.rows)

    def read(self):
        """Return all of it as one array of float64."""
        return np.concatenate([np.asarray(value, dtype=float).ravel() for value in self._values()] or [np.zeros(0)])

    def write(self, numbers):
        """Set all of it."""
        start = 0
        for owner, name in self.attributes:
            value = getattr(owner, name)
            shape, kind = np.shape(value), np.asarray(value).dtype
            new = np.array(numbers[start : start + np.size(value)], dtype=kind).reshape(shape)
            setattr(owner, name, new if shape else new[()])
            start += np.size(value)
        for array, row in self.rows:
            array[row] = numbers[start : start + array.shape[1]]
            start += array.shape[1]

"""Counts what is converted and copied of torch's tensors, whoever asks for it.

Copies are counted where torch dispatches its operations, conversions by the calls that make them: torch dispatches
nothing for an array that is given the memory of a tensor.
"""

import importlib
from contextlib import contextmanager

COPIES = {"aten::clone": "clone", "aten::_to_copy": "cast or move", "aten::copy_": "copy into"}
"""Operations of torch that write the values of a tensor into other memory."""

OF_TENSORS = {"numpy": "to numpy", "__array__": "to numpy", "tolist": "to list", "item": "to number", "cpu": "cpu()"}
OF_TORCH = ("from_numpy", "as_tensor", "tensor")
FROM_NUMPY = "from numpy"


class Counts:
    """Numbers of conversions and copies, by the place that they were asked for from; outside of `counted` none are."""

    def __init__(self):
        self.where = None
        self.by_place = {}
        self._inside = False

    @contextmanager
    def counted(self, where):
        """Count what is asked for in this block, for a place."""
        import numpy as np

        torch = importlib.import_module("torch")
        with _replaced(self, torch, np.ndarray), _mode(self):
            self.where = where
            try:
                yield
            finally:
                self.where = None

    @contextmanager
    def at(self, where):
        """Count for another place in this block, or for none, if anything is counted."""
        before, self.where = self.where, where if self.where else None
        try:
            yield
        finally:
            self.where = before

    def add(self, kind):
        """Count one."""
        if self.where:
            counts = self.by_place.setdefault(self.where, {})
            counts[kind] = counts.get(kind, 0) + 1

    def called(self, function, kind, matters):
        """Return the function, its calls counted if `matters` says so of the arguments; inner calls do not count."""

        def counting(*values, **named):
            outermost, self._inside = not self._inside, True
            try:
                if outermost and matters(*values):
                    self.add(kind)
                return function(*values, **named)
            finally:
                self._inside = not outermost

        return counting


@contextmanager
def _replaced(counts, torch, array):
    """Stand in for the calls that convert."""
    stands = [(torch.Tensor, name, kind, lambda *_: True) for name, kind in OF_TENSORS.items()]
    stands += [(torch, name, FROM_NUMPY, lambda *values: isinstance(values[0], array)) for name in OF_TORCH]
    kept = [(owner, name, vars(owner).get(name)) for owner, name, _, _ in stands]
    for owner, name, kind, matters in stands:
        setattr(owner, name, counts.called(getattr(owner, name), kind, matters))
    try:
        yield
    finally:
        for owner, name, own in kept:
            if own is None:
                delattr(owner, name)
            else:
                setattr(owner, name, own)


def _mode(counts):
    """Return a mode of torch that sees every operation."""
    modes = importlib.import_module("torch.utils._python_dispatch")

    class Seen(modes.TorchDispatchMode):
        def __torch_dispatch__(self, function, _types, values=(), named=None):
            kind = COPIES.get(function._schema.name)
            if kind:
                counts.add(kind)
            return function(*values, **(named or {}))

    return Seen()

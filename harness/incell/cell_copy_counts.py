"""Count the conversions and copies of torch's tensors, whoever asks for them.

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
    """Count conversions and copies by the place that they are requested from, within `count_for` alone."""

    def __init__(self):
        self.where = None
        self.by_place = {}
        self._inside = False

    @contextmanager
    def count_for(self, where):
        """Count what happens in this block, for a place."""
        import numpy as np

        torch = importlib.import_module("torch")
        with _watch_conversions(self, torch, np.ndarray), _watch_copies(self):
            self.where = where
            try:
                yield
            finally:
                self.where = None

    @contextmanager
    def at(self, where):
        """Count for another place in this block, or for none, where anything is counted."""
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

    def count_calls(self, function, kind, matters):
        """Wrap a function to count the calls whose arguments `matters` accepts; inner calls do not count."""

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
def _watch_conversions(counts, torch, array):
    """Count the calls that convert, in a block."""
    replacements = [(torch.Tensor, name, kind, lambda *_: True) for name, kind in OF_TENSORS.items()]
    replacements += [(torch, name, FROM_NUMPY, lambda *values: isinstance(values[0], array)) for name in OF_TORCH]
    originals = [(owner, name, vars(owner).get(name)) for owner, name, _, _ in replacements]
    for owner, name, kind, matters in replacements:
        setattr(owner, name, counts.count_calls(getattr(owner, name), kind, matters))
    try:
        yield
    finally:
        for owner, name, original in originals:
            if original is None:
                delattr(owner, name)
            else:
                setattr(owner, name, original)


def _watch_copies(counts):
    """Return a mode of torch that sees every operation."""
    modes = importlib.import_module("torch.utils._python_dispatch")

    class CountCopies(modes.TorchDispatchMode):
        def __torch_dispatch__(self, function, _types, values=(), named=None):
            kind = COPIES.get(function._schema.name)
            if kind:
                counts.add(kind)
            return function(*values, **(named or {}))

    return CountCopies()

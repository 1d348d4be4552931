"""The bridge to PyTorch, which is not in the stubs: `wrap_tensor` as NVIDIA's documentation of tensors has it.

What it gives has the few methods of a tensor that the documentation's examples use.
"""

import numpy as np

from . import machine

if machine.failure("gymtorch").get("import") == "hang":
    machine.hang()


class Tensor:
    """An array on a device: to be copied before numpy sees it."""

    def __init__(self, array, device="cuda:0"):
        self._array = array
        self._device = device

    def cpu(self):
        """The same on the host."""
        return Tensor(self._array.copy(), "cpu")

    def numpy(self):
        """The array."""
        if self._device != "cpu":
            message = f"can't convert {self._device} device type tensor to numpy."
            raise TypeError(message)
        return self._array

    def clone(self):
        """Another tensor of the same values."""
        return Tensor(self._array.copy(), self._device)

    def copy_(self, other):
        """Take over the values of another."""
        np.copyto(self._array, other._array)
        return self


def wrap_tensor(gym_tensor, offsets=None, counts=None):
    """A tensor over the memory of a buffer of Isaac Gym's."""
    return Tensor(gym_tensor.memory)

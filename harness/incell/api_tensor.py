"""Drive environments that speak torch tensors, many worlds at once: `tensor:module:callable`.

They have gymnasium's calls, and a first dimension of `num_envs` worlds in whatever goes in and out; the next episode
of a world begins by itself.
"""

from .cell_adapter import Adapter
from .cell_batched_worlds import TensorWorlds
from .cell_callables import user_callable
from .cell_errors import library, skip, violate
from .cell_values import describe_value


class Tensors(Adapter):
    """A user's callable that makes an environment; it is given the case's `kwargs`."""

    imports = ("torch", "gymnasium")

    def modules(self, case):
        """Return torch, gymnasium, and the module of the callable."""
        factory = user_callable(case)
        return [*self.imports, *([factory.module] if factory else [])]

    def has_environment(self, case):
        """Return whether it is a callable."""
        factory = user_callable(case)
        return factory is not None and factory.exists()

    def make(self, case, report, draw=False):
        """Make the environment of a case."""
        if draw:
            skip("tensor.no_pictures")
        with library:
            raw = self.make_raw(case)
            space = raw.single_action_space
        return Batch(raw, raw, report, space.low, space.high)

    def make_raw(self, case, **more):
        """Make the user's own object."""
        factory = user_callable(case)
        if factory is None or not factory.exists():
            violate("tensor.not_callable", got=case["env"])
        return factory.make(dict(case["kwargs"], **more))


class Batch(TensorWorlds):
    """All worlds of a user's environment, driven by random actions within its space."""

    def as_array(self, where, tensor):
        """Return the values of a tensor, which has to lie where the environment computes, as a numpy array."""
        if not isinstance(tensor, self.torch.Tensor):
            violate("value.as_other", where=where, got=describe_value(tensor), promised="a tensor")
        if tensor.device != self.torch.device(self.raw.device):
            violate("tensor.device", where=where, got=str(tensor.device), promised=str(self.raw.device))
        return tensor.detach().cpu().numpy().copy()

    def compare(self, where, array, space):
        """Report another dtype, and values outside the space."""
        if array.dtype != space.dtype:
            self.report("type", "tensor.dtype", where=where, got=str(array.dtype), promised=str(space.dtype))
        if not (array >= space.low).all() or not (array <= space.high).all():
            self.report("space", "tensor.outside", where=where)


API = Tensors()

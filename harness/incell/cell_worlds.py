"""Simulators that step one world or many at once, and whose values are arrays of another library than numpy."""

from .cell_adapter import Adapter, Environment
from .cell_errors import skip, violate
from .cell_values import numbers


class Worlds(Adapter):
    """Several environments are several worlds of one simulation, as users of these simulators have them."""

    name = "it"

    def make(self, case, tell, draw=False):
        """Make a simulation of one world."""
        if draw:
            skip("worlds.no_pictures", name=self.name)
        return self.simulate(case, tell)

    def make_vector(self, makers, way, tell):
        """Make one simulation with a world for each maker; there are no workers."""
        if way is not None:
            skip("worlds.no_workers", name=self.name)
        return self.simulate(makers[0].case, tell, len(makers))

    def simulate(self, case, tell, worlds=None):
        """Make a simulation of one world, or of several as one: a `World`."""
        raise NotImplementedError


class World(Environment):
    """A simulation with random actions between `low` and `high`: no reward, no end.

    `shape` is () for one world and (n,) for several, which stand first in the shapes of all arrays.
    """

    def __init__(self, tell, worlds, low, high):
        import numpy as np

        super().__init__(tell)
        self.shape = () if worlds is None else (worlds,)
        self.low, self.high = low, high
        self.random = np.random.RandomState(0)

    def seen(self, where, value, shape):
        """Copy an array of the library, as numpy sees it: floating-point numbers of this shape for each world."""
        array, promised = numbers(value, where), self.shape + tuple(shape)
        if array.dtype.kind != "f":
            violate("worlds.not_floats", where=where, got=str(array.dtype))
        if array.shape != promised:
            violate("worlds.shape", where=where, got=str(array.shape), promised=str(promised))
        return array.copy()

    def stepped(self, observation):
        """Complete an observation to what a step returns."""
        import numpy as np

        never = np.zeros(self.shape, dtype=bool)
        return observation, np.zeros(self.shape), never, never

    def seed_actions(self, seed):
        """Seed what draws actions."""
        self.random.seed(seed)

    def action(self):
        """Draw actions for all worlds."""
        drawn = self.random.uniform(self.low, self.high, size=self.shape + self.low.shape)
        return drawn.astype("float32")

import fake_healthy
import gymnasium
import numpy


class Reseed(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.rng = numpy.random.default_rng(7)

    def observe(self):
        return self.rng.uniform(-1, 1, 3).astype(numpy.float32)


gymnasium.register("Reseed-v0", Reseed)

import ctypes

import fake_healthy
import gymnasium


class Segfault(fake_healthy.Healthy):
    def step(self, action):
        ctypes.string_at(0)


gymnasium.register("Segfault-v0", Segfault)

import ctypes

import fake_healthy
import gymnasium


class Fragile(fake_healthy.Healthy):
    def reset(self, *, seed=None, options=None):
        if options is not None:
            ctypes.string_at(0)
        return super().reset(seed=seed)


gymnasium.register("Fragile-v0", Fragile)

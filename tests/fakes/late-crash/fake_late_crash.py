import atexit
import ctypes

import fake_healthy
import gymnasium


class LateCrash(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        atexit.register(ctypes.string_at, 0)


gymnasium.register("LateCrash-v0", LateCrash)

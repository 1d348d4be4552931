import atexit

import fake_healthy
import gymnasium


class LateRaise(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        atexit.register(self.release)

    def release(self):
        raise RuntimeError("the GL context is gone")


gymnasium.register("LateRaise-v0", LateRaise)

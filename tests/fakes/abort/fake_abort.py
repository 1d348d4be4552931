import os

import fake_healthy
import gymnasium


class Abort(fake_healthy.Healthy):
    def step(self, action):
        os.write(2, b"physics.c:12: advance: Assertion `mass > 0' failed.\n")
        os.abort()


gymnasium.register("Abort-v0", Abort)

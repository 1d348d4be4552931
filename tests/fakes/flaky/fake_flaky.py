import os

import fake_healthy
import gymnasium


class Flaky(fake_healthy.Healthy):
    def step(self, action):
        if not os.path.exists(os.environ["FAKE_TRIED"]):
            open(os.environ["FAKE_TRIED"], "w").close()
            raise OSError("the device is busy")
        return super().step(action)


gymnasium.register("Flaky-v0", Flaky)

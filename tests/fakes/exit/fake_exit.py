import os

import fake_healthy
import gymnasium


class Exit(fake_healthy.Healthy):
    def reset(self, **kwargs):
        os._exit(3)


gymnasium.register("Exit-v0", Exit)

import os
import time

import fake_healthy
import gymnasium


class Gate(fake_healthy.Healthy):
    def step(self, action):
        open(os.environ["FAKE_GATE"] + ".reached", "w").close()
        while not os.path.exists(os.environ["FAKE_GATE"]):
            time.sleep(0.05)
        return super().step(action)


gymnasium.register("Gate-v0", Gate)

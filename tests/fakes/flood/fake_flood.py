import os

import fake_healthy
import gymnasium


class Flood(fake_healthy.Healthy):
    def step(self, action):
        while True:
            os.write(1, b"the solver did not converge\n" * 2000)


gymnasium.register("Flood-v0", Flood)

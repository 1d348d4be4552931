import signal
import time

import fake_healthy
import gymnasium


class Hang(fake_healthy.Healthy):
    def step(self, action):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        while True:
            time.sleep(60)


gymnasium.register("Hang-v0", Hang)

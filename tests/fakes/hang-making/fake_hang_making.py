import threading

import fake_healthy
import gymnasium


class HangMaking(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        threading.Event().wait()


gymnasium.register("HangMaking-v0", HangMaking)

import ctypes
import multiprocessing
import os
import time

import fake_healthy
import gymnasium


class Worker(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        if multiprocessing.parent_process():
            self.trouble()


class Raises(Worker):
    def trouble(self):
        raise ValueError("XML Error: Schema violation: unrecognized attribute: 'springinertia'\n\nElement 'body', line 3")


class Exits(Worker):
    def trouble(self):
        os._exit(5)


class Crashes(Worker):
    def trouble(self):
        ctypes.string_at(0)


class Hangs(Worker):
    def trouble(self):
        time.sleep(600)


for kind in (Raises, Exits, Crashes, Hangs):
    gymnasium.register(f"{kind.__name__}-v0", kind)

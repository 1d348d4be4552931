import os

import fake_healthy
import gymnasium

CACHE = os.path.join(os.path.dirname(__file__), "fake_writer_cache.txt")
KNOWN_BEFORE = os.path.exists(CACHE)

with open(CACHE, "w") as file:
    file.write("compiled once")


class Writer(fake_healthy.Healthy):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        if KNOWN_BEFORE:
            raise RuntimeError("somebody else's cache")
        with open(fake_healthy.__file__, "a") as file:
            file.write("\nraise ImportError('a neighbour was here')\n")


gymnasium.register("Writer-v0", Writer)

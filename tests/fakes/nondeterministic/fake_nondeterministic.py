import os

import fake_healthy
import gymnasium


class Nondeterministic(fake_healthy.Healthy):
    def observe(self):
        return super().observe() * 0 + int.from_bytes(os.urandom(4), "big") / 2**32


gymnasium.register("Nondeterministic-v0", Nondeterministic)

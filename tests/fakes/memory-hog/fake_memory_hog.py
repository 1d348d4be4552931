import fake_healthy
import gymnasium


class MemoryHog(fake_healthy.Healthy):
    def step(self, action):
        kept = []
        while True:
            kept.append(b"x" * (16 << 20))


gymnasium.register("MemoryHog-v0", MemoryHog)

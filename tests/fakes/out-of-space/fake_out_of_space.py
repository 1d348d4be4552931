import fake_healthy
import gymnasium


class OutOfSpace(fake_healthy.Healthy):
    def observe(self):
        return super().observe() + 5


gymnasium.register("OutOfSpace-v0", OutOfSpace)

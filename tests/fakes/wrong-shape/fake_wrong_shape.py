import fake_healthy
import gymnasium


class WrongShape(fake_healthy.Healthy):
    def observe(self):
        return super().observe()[:2]


gymnasium.register("WrongShape-v0", WrongShape)

import fake_healthy
import gymnasium


class NonFinite(fake_healthy.Healthy):
    def observe(self):
        return super().observe() * (float("nan") if self.steps == 5 else 1)


gymnasium.register("NonFinite-v0", NonFinite)

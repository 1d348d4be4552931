import fake_healthy
import gymnasium


class WrongDtype(fake_healthy.Healthy):
    def observe(self):
        return super().observe() + 1j


gymnasium.register("WrongDtype-v0", WrongDtype)

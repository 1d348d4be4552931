import fake_healthy
import gymnasium


class WrongDtype(fake_healthy.Healthy):
    def observe(self):
        return super().observe().astype("float64")


gymnasium.register("WrongDtype-v0", WrongDtype)

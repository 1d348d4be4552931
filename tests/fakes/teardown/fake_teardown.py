import fake_healthy
import gymnasium


class Teardown(fake_healthy.Healthy):
    def close(self):
        raise RuntimeError("the viewer is gone")


gymnasium.register("Teardown-v0", Teardown)

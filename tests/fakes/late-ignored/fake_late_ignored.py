import fake_healthy
import gymnasium


class LateIgnored(fake_healthy.Healthy):
    context = "a context"

    def close(self):
        self.context = None

    def __del__(self):
        if self.context is not None:
            raise RuntimeError("the GL context is lost")


gymnasium.register("LateIgnored-v0", LateIgnored)

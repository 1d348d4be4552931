import os

import fake_healthy
import gymnasium


class DummyBlack(fake_healthy.Healthy):
    def render(self):
        return super().render() * (os.environ.get("SDL_VIDEODRIVER") != "dummy")


gymnasium.register("DummyBlack-v0", DummyBlack)

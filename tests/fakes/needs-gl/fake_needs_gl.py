import fake_healthy
import gymnasium


class NeedsGl(fake_healthy.Healthy):
    def render(self):
        import glfw

        raise RuntimeError("%s: no display to draw on" % glfw.__name__)


gymnasium.register("NeedsGl-v0", NeedsGl)

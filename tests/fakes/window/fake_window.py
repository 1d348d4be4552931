import fake_healthy
import gymnasium


class Window(fake_healthy.Healthy):
    def render(self):
        import pyglet

        pyglet.window()
        return super().render()


gymnasium.register("Window-v0", Window)

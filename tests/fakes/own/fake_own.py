import fake_healthy


def make(size=3, render_mode=None):
    """Draws if asked to."""
    assert size == 3
    return fake_healthy.Healthy(render_mode=render_mode)


class Robots:
    @staticmethod
    def small():
        """Draws without being asked to."""
        return fake_healthy.Healthy(render_mode="rgb_array")

import fake_healthy
import gymnasium
import numpy


class Sky(fake_healthy.Healthy):
    """Sky above, ground below, and something that moves on it; its buffer is its own, as those of libraries are."""

    sky, ground = (90, 150, 220), (60, 120, 40)

    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        self.frame = numpy.zeros((32, 48, 3), numpy.uint8)

    def render(self):
        self.draw(self.steps)
        return self.frame

    def draw(self, steps):
        self.frame[:16] = self.sky
        self.frame[16:] = self.ground
        self.frame[12:16, 2 * steps : 2 * steps + 4] = 200, 60, 20


class UpsideDown(Sky):
    def render(self):
        return super().render()[::-1]


class WrongColours(Sky):
    def render(self):
        return super().render()[:, :, ::-1]


class Constant(Sky):
    def draw(self, steps):
        super().draw(0)


class AtResets(Sky):
    """Draws the episode, not the step."""

    episode = 0

    def reset(self, *, seed=None, options=None):
        self.episode += 1
        return super().reset(seed=seed)

    def draw(self, steps):
        super().draw(self.episode)


class Behind(Sky):
    """Draws into one buffer and hands out the one before."""

    waiting = None

    def render(self):
        shown = self.waiting
        self.waiting = super().render().copy()
        return self.waiting if shown is None else shown


class Floats(Sky):
    def render(self):
        return super().render() / numpy.float32(255)


class Flat(Sky):
    def render(self):
        return super().render()[:, :, 0]


class Nothing(Sky):
    def render(self):
        return None


class Still(Sky):
    """Nothing moves, and nothing is drawn that does."""

    def observe(self):
        return numpy.zeros(3, numpy.float32)

    def draw(self, steps):
        super().draw(0)


for kind in (Sky, UpsideDown, WrongColours, Constant, AtResets, Behind, Floats, Flat, Nothing, Still):
    gymnasium.register("{}-v0".format(kind.__name__), kind)

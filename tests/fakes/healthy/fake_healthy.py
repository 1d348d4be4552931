import gymnasium
import numpy


class Healthy(gymnasium.Env):
    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}
    observation_space = gymnasium.spaces.Box(-1, 1, (3,), numpy.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self.observe(), {}

    def step(self, action):
        self.steps += 1
        return self.observe(), 1.0, False, self.steps == 10, {}

    def observe(self):
        return self.np_random.uniform(-1, 1, 3).astype(numpy.float32)

    def render(self):
        frame = numpy.zeros((32, 48, 3), numpy.uint8)
        frame[8:24, 8 : 10 + self.steps] = 200, 60, 20
        return frame


gymnasium.register("Healthy-v0", Healthy)

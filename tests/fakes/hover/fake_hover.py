import gymnasium
import numpy

VERSION = "@VERSION@"
GRAVITY = 12.5 if VERSION == "2.0" else 9.81


class Hover(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1000, 1000, (2,), numpy.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), numpy.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = numpy.array([self.np_random.uniform(-0.5, 0.5), 0.0])
        self.steps = 0
        return self.state.copy(), {}

    def step(self, action):
        height, speed = self.state
        push, drag = 12.0 * float(action[0]), -0.1 * speed
        speed += 0.05 * (drag - GRAVITY + push if VERSION == "1.1" else push + drag - GRAVITY)
        height += 0.05 * speed
        self.state = numpy.array([height, speed])
        self.steps += 1
        ended = self.steps == 60
        return self.state.copy(), -abs(height), False, ended, {"success": float(ended and abs(height) < 0.1)}


gymnasium.register("Hover-v0", Hover)

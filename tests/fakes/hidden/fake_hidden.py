import math

import gymnasium
import numpy

VERSION = "@VERSION@"
GRAVITY = 9.81 * (1.001 if VERSION == "2.0" else 1.0)


class Hidden(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-100, 100, (2,), numpy.float64)
    action_space = gymnasium.spaces.Box(-1, 1, (1,), numpy.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._hidden = self.np_random.uniform(-1, 1, 2)
        return self._hidden.copy(), {}

    def step(self, action):
        angle, speed = self._hidden
        pull, drag, push = -GRAVITY * math.sin(angle), -0.1 * speed, 0.5 * float(action[0])
        change = push + drag + pull if VERSION == "1.1" else pull + drag + push
        speed += 0.05 * change
        angle += 0.05 * speed
        self._hidden = numpy.array([angle, speed])
        return self._hidden.copy(), -angle * angle, abs(angle) > 3, False, {}


gymnasium.register("Hidden-v0", Hidden)

import fake_healthy
import gymnasium
import numpy


class VectorReward(fake_healthy.Healthy):
    reward_space = gymnasium.spaces.Box(-1, 1, (2,), numpy.float32)

    def step(self, action):
        observation, _, terminated, truncated, info = super().step(action)
        return observation, numpy.array([1.0, -0.5], numpy.float32), terminated, truncated, info


class Undeclared(VectorReward):
    reward_space = None


gymnasium.register("VectorReward-v0", VectorReward)
gymnasium.register("Undeclared-v0", Undeclared)

import os

import fake_healthy
import gymnasium
import numpy


class Vector(gymnasium.vector.VectorEnv):
    def __init__(self, num_envs=1, defect=None):
        self.num_envs, self.defect = num_envs, defect
        self.single_observation_space = fake_healthy.Healthy.observation_space
        self.single_action_space = fake_healthy.Healthy.action_space
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed=None, options=None):
        if self.defect == "unseeded":
            seed = int.from_bytes(os.urandom(4), "big")
        self.random = numpy.random.default_rng(seed)
        return self.observe(), {}

    def step(self, actions):
        ends = numpy.zeros(self.num_envs, bool)
        return self.observe(), numpy.ones(self.num_envs), ends, ends.copy(), {}

    def observe(self):
        if self.defect == "constant":
            return numpy.zeros((self.num_envs, 3), numpy.float32)
        return self.random.uniform(-1, 1, (self.num_envs, 3)).astype(numpy.float32)


class Alone(fake_healthy.Healthy):
    def __init__(self, render_mode=None, defect=None):
        super().__init__(render_mode)


gymnasium.register("OwnVector-v0", Alone, vector_entry_point=Vector)

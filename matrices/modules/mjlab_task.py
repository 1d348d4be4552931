"""Make a task of mjlab on a CPU, as its scripts do; random actions lie between -1 and 1, which mjlab does not bound."""

import mjlab.tasks
import numpy as np
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import load_env_cfg

assert mjlab.tasks  # it registers the tasks


class Actions:
    """The space of one world's actions."""

    def __init__(self, size):
        self.low, self.high = -np.ones(size, "float32"), np.ones(size, "float32")

    def __str__(self):
        return "Box(-1, 1, {})".format(self.low.shape)


class Task:
    """A task of mjlab with bounds for its actions."""

    def __init__(self, env):
        self.env = env
        self.num_envs, self.device = env.num_envs, env.device
        self.single_observation_space = env.single_observation_space
        self.single_action_space = Actions(env.single_action_space.shape)
        self.reset, self.step, self.close = env.reset, env.step, env.close


def make(task="Mjlab-Cartpole-Balance", num_envs=2):
    """Make so many worlds of a task."""
    settings = load_env_cfg(task)
    settings.scene.num_envs = num_envs
    return Task(ManagerBasedRlEnv(cfg=settings, device="cpu"))

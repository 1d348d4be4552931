"""A task as LeRobot itself makes it, and as one Gymnasium environment: its factory, and what it makes of observations.

`lerobot.envs.factory.make_env` gives a vector environment, here of one; `preprocess_observation` turns its observations
into the tensors that policies take.
"""

from typing import ClassVar

import gymnasium
import numpy as np
from lerobot.envs.factory import make_env, make_env_config
from lerobot.envs.utils import preprocess_observation


class LeRobotTask(gymnasium.Env):
    """The first world of a vector environment by LeRobot's factory."""

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, name, render_mode=None):
        envs = make_env(make_env_config(name), n_envs=1)
        while isinstance(envs, dict):  # since 0.4: {suite: {task: vector environment}}
            envs = next(iter(envs.values()))
        self.envs = envs
        self.render_mode = render_mode
        parts = self._preprocess(self.envs.reset(seed=0)[0])
        boxes = {name: gymnasium.spaces.Box(-np.inf, np.inf, part.shape, part.dtype) for name, part in parts.items()}
        self.observation_space = gymnasium.spaces.Dict(boxes)
        self.action_space = self.envs.single_action_space

    def reset(self, *, seed=None, options=None):
        """Reset the vector environment."""
        super().reset(seed=seed)
        observation, _ = self.envs.reset(seed=seed)
        return self._preprocess(observation), {}

    def step(self, action):
        """Make one step with an action for the one world."""
        observation, reward, terminated, truncated, _ = self.envs.step(np.asarray(action)[None])
        return self._preprocess(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), {}

    def render(self):
        """Return the picture of the one world."""
        return self.envs.call("render")[0]

    def close(self):
        """Close the vector environment."""
        self.envs.close()

    def _preprocess(self, observation):
        """Return the tensors of LeRobot as arrays, without the dimension of worlds."""
        return {name: tensor[0].numpy() for name, tensor in preprocess_observation(observation).items()}


def make(name="pusht", render_mode=None):
    """Make a task by the name of LeRobot's configuration."""
    return LeRobotTask(name, render_mode)

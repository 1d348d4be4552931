"""An environment that is well in the process that starts workers, and comes to an end in a worker.

The variable PLACE says where (`constructor`, `reset`, `step`), END how: it raises, crashes, is killed, exits, or hangs.
"""

import ctypes
import multiprocessing
import os
import sys
import time

import numpy as np

try:
    import gymnasium as gym
except ImportError:
    import gym

MODERN = gym.__name__ == "gymnasium" or not hasattr(gym.Env, "seed")
LONG = 1000.0


def make():
    """Make one of the API that the library speaks."""
    return Modern() if MODERN else Classic()


class Dying(gym.Env):
    metadata = {"render_modes": [], "render.modes": []}  # noqa: RUF012 - as in every user's environment
    observation_space = gym.spaces.Box(-1, 1, (3,), np.float32)
    action_space = gym.spaces.Discrete(2)

    def __init__(self):
        self.comes_to("constructor")

    def comes_to(self, place):
        """Come to an end here, in a worker."""
        if place == os.environ["PLACE"] and multiprocessing.current_process().name != "MainProcess":
            getattr(self, os.environ["END"])()

    def raises(self):
        message = "the true reason"
        raise ValueError(message)

    def crashes(self):
        ctypes.string_at(0)

    def killed(self):
        os.kill(os.getpid(), 9)

    def exits(self):
        os._exit(7)

    def leaves(self):
        sys.exit(3)

    def hangs(self):
        time.sleep(LONG)

    def observed(self):
        return np.zeros(3, np.float32)


class Modern(Dying):
    """The API of five values."""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.comes_to("reset")
        return self.observed(), {}

    def step(self, action):
        self.comes_to("step")
        return self.observed(), 0.0, False, False, {}


class Classic(Dying):
    """The API of four values."""

    def seed(self, seed=None):
        return [seed]

    def reset(self):
        self.comes_to("reset")
        return self.observed()

    def step(self, action):
        self.comes_to("step")
        return self.observed(), 0.0, False, {}

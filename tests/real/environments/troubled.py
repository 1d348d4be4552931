"""An environment that goes wrong in one way, named by `mode`: `PLACE-HOW` or a word for what it returns.

With `child-` before HOW only a worker goes wrong. It speaks the API of the library that LIBRARY names, else of the one
that is there.
"""

import ctypes
import importlib.util
import multiprocessing
import os
import signal
import sys
import time

import numpy as np

LIBRARY = os.environ.get("LIBRARY") or ("gymnasium" if importlib.util.find_spec("gymnasium") else "gym")
gym = __import__(LIBRARY)
register = __import__(LIBRARY + ".envs.registration", fromlist=["register"]).register


def _raise():
    reason = "the true reason"
    raise ValueError(reason)


HOW = {
    "raise": _raise,
    "segv": lambda: ctypes.string_at(0),
    "kill": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "exit": lambda: os._exit(7),
    "sysexit": lambda: sys.exit(3),
    "hang": lambda: time.sleep(1000),
}


class Troubled(gym.Env):
    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012 - as in every user's environment
    random = np.random.default_rng()

    def __init__(self, mode="", render_mode=None):
        self.mode = mode
        self.render_mode = render_mode
        self.observation_space = gym.spaces.Box(-1, 1, (3,), np.float32)
        self.action_space = gym.spaces.Discrete(2)
        self.resets = self.seeded = self.steps = 0
        self.trouble("make")
        if mode == "raising":
            np.seterr(all="raise")

    def trouble(self, place):
        where, _, how = self.mode.partition("-")
        spared = how.startswith("child-") and multiprocessing.current_process().name == "MainProcess"
        how = how.rpartition("-")[2]
        if where == place and how in HOW and not spared:
            HOW[how]()

    def observation(self):
        values = (0.5 * self.np_random.random(3)).astype(np.float32)
        changed = {
            "nan": lambda: values * np.nan,
            "list": lambda: [float(value) for value in values],
            "float64": lambda: values.astype(np.float64),
            "float16": lambda: values.astype(np.float16),
            "shape": lambda: values[:2],
            "outside": lambda: values + 5,
            "none": lambda: None,
            "unseeded": lambda: self.random.random(3).astype(np.float32),
            "raising": lambda: np.full(3, 1.7e308 * (-1) ** self.steps),
            "shared": lambda: self.random.random(3).astype(np.float32),
        }
        return changed.get(self.mode, lambda: values)()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if self.mode == "shared" and seed is not None:
            Troubled.random = np.random.default_rng(seed)
        self.steps = 0
        self.resets += 1
        if self.resets > 1:
            self.trouble("again")
        self.trouble("reset")
        if (self.mode == "firstepisode" and self.resets == 1) or self.mode == "eachepisode":
            self.np_random.random(self.resets)
        if self.mode == "fewtasks" and seed is not None:
            self.seeded += 1
            self.np_random.random(int("011010"[self.seeded % 6 - 1]))
        return self.observation() if self.mode == "noinfo" else (self.observation(), {})

    def step(self, action):
        self.steps += 1
        if self.steps == 3:
            self.trouble("step")
        reward = {"noreward": None, "infinite": float("inf"), "rewards": np.ones(1)}.get(self.mode, 1.0)
        terminated = self.steps >= 20
        if self.mode == "four":
            return self.observation(), reward, terminated, {}
        return self.observation(), reward, int(terminated) if self.mode == "integer" else terminated, False, {}

    def render(self):
        self.trouble("render")
        frame = np.arange(32 * 48 * 3).reshape(32, 48, 3).astype(np.uint8)
        changed = {
            "blank": frame * 0 + 7,
            "nothing": None,
            "alpha": np.dstack([frame, frame[:, :, 0] * 0 + 255]),
            "frames": [frame],
            "floats": frame / 255,
            "gray": frame[..., 0],
        }
        return changed.get(self.mode, frame)

    def close(self):
        self.trouble("close")


class Blind(Troubled):
    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, mode=""):
        super().__init__(mode)


class Old(Troubled):
    def reset(self):
        return self.observation()


class Classic(Troubled):
    """The same environment in the API before gym 0.26."""

    metadata = {"render.modes": ["rgb_array"], "render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, mode=""):
        super().__init__(mode)
        self.np_random = np.random.default_rng()

    def seed(self, seed=None):
        if self.mode != "deaf":
            self.np_random = np.random.default_rng(seed)
        return [seed]

    def reset(self):
        self.steps = 0
        self.resets += 1
        self.trouble("reset")
        return (self.observation(), {}) if self.mode == "pair" else self.observation()

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        if self.mode == "five":
            return observation, reward, terminated, truncated, info
        return observation, reward, terminated, None if self.mode == "noinfo" else info

    def render(self, mode="human"):
        return super().render()


Spoken = Classic if hasattr(gym.Env, "seed") else Troubled
register("Troubled-v0", entry_point=Spoken)
if Spoken is Troubled:
    register("Blind-v0", entry_point=Blind)
    register("Old-v0", entry_point=Old)

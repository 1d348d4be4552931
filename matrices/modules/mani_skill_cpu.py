"""Make a task of ManiSkill as Gymnasium's own loops take it: one world on a CPU, whose values are numpy arrays."""

import gymnasium
import mani_skill.envs
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

assert mani_skill.envs  # it registers the tasks


def make(task="PickCube-v1", **options):
    """Make a task and wrap it, as ManiSkill's own examples for a CPU do."""
    return CPUGymWrapper(gymnasium.make(task, num_envs=1, obs_mode="state", sim_backend="physx_cpu", **options))

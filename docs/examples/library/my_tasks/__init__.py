import gymnasium
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv


class SlowHopper(HopperEnv):
    """A hopper that is paid for standing still."""

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, float(reward - abs(info["x_velocity"])), terminated, truncated, info


gymnasium.register("my_tasks/SlowHopper-v0", entry_point="my_tasks:SlowHopper", max_episode_steps=1000)

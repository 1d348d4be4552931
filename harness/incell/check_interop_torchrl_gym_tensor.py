"""Wrap an environment by GymWrapper that passes actions on as they are."""

from .cell_torchrl import gym_check

run = gym_check(convert_actions_to_numpy=False)

"""Wrap an environment by GymWrapper as it is, which converts actions to numpy."""

from .cell_torchrl import gym_check

run = gym_check()

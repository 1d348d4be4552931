"""Wraps an environment by GymWrapper as it is."""

from .cell_torchrl import gym as run

__all__ = ["run"]

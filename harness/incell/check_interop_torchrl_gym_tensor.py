"""Wraps an environment by GymWrapper that passes actions on as they are."""

from .cell_torchrl import gym_tensor as run

__all__ = ["run"]

"""Makes an environment by GymEnv."""

from .cell_torchrl import backend as run

__all__ = ["run"]

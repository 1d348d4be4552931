"""Wraps an environment by IsaacLabWrapper that leaves it to begin episodes."""

from .cell_torchrl import isaaclab_native as run

__all__ = ["run"]

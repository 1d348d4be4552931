"""Wraps an environment by IsaacLabWrapper."""

from .cell_torchrl import isaaclab as run

__all__ = ["run"]

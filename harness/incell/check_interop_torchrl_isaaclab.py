"""Wrap an environment by IsaacLabWrapper."""

from .cell_torchrl import isaaclab_check

run = isaaclab_check()

"""Wrap an environment by IsaacLabWrapper that leaves it to begin episodes."""

from .cell_torchrl import isaaclab_check

run = isaaclab_check(native_autoreset=True)

"""Compares the start pose with the documented one."""

from .cell_start import start_pose as run

__all__ = ["run"]

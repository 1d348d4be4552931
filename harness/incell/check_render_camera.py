"""Compares the camera with the one that was asked for."""

from .cell_camera import camera as run

__all__ = ["run"]

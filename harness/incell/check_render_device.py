"""Draws, and compares the device with the one that was asked for."""

from .cell_device import device as run

__all__ = ["run"]

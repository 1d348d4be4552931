"""The adapter of gym, every generation."""

from .cell_classic import Gym

API = Gym()

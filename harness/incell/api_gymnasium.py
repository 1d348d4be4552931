"""Drive gymnasium."""

from .cell_gym_modern import GymnasiumAdapter

PACKAGES = {"gymnasium": "gymnasium"}

API = GymnasiumAdapter("gymnasium")

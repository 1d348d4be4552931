"""The adapter of gym, every generation."""

from .cell_classic import Gym

PACKAGES = {"gym": "gym"}
DRAWS = ("mujoco_py",)
READS_MUJOCO_GL = ("mujoco-py", "free-mujoco-py")

API = Gym()

"""Drive gym, every generation."""

from .cell_gym_classic import GymAdapter

PACKAGES = {"gym": "gym"}
DRAWS = ("mujoco_py",)
READS_MUJOCO_GL = ("mujoco-py", "free-mujoco-py")

API = GymAdapter()

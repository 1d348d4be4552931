"""A module of the name `mujoco_py` and nothing in it: robomimic before 0.3.1 imports that name only."""

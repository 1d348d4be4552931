"""The packages that decide whether a simulation runs: what they are imported as, and what a change of one weighs."""

from __future__ import annotations

from typing import Dict

MODULES = {
    "numpy": "numpy",
    "scipy": "scipy",
    "gym": "gym",
    "gymnasium": "gymnasium",
    "mujoco": "mujoco",
    "dm-control": "dm_control",
    "robosuite": "robosuite",
    "pybullet": "pybullet",
    "gymnasium-robotics": "gymnasium_robotics",
    "metaworld": "metaworld",
    "pettingzoo": "pettingzoo",
    "shimmy": "shimmy",
    "stable-baselines3": "stable_baselines3",
    "pygame": "pygame",
    "pygame-ce": "pygame",
    "pyglet": "pyglet",
    "glfw": "glfw",
    "pyopengl": "OpenGL",
    "opencv-python": "cv2",
    "opencv-python-headless": "cv2",
    "opencv-contrib-python": "cv2",
    "opencv-contrib-python-headless": "cv2",
    "imageio": "imageio",
    "box2d-py": "Box2D",
    "box2d": "Box2D",
    "ale-py": "ale_py",
    "torch": "torch",
    "torchrl": "torchrl",
    "tensordict": "tensordict",
    "jax": "jax",
    "mujoco-mjx": "mujoco.mjx",
    "brax": "brax",
    "warp-lang": "warp",
    "mujoco-warp": "mujoco_warp",
    "newton": "newton",
    "numba": "numba",
    "h5py": "h5py",
    "robomimic": "robomimic",
    "diffusion-policy": "diffusion_policy",
}
"""Distribution: the module that it is imported as, in the order in which they are tried."""

LEFT_OUT = {
    "mujoco-py": "it compiles itself into the environment when it is imported",
    "d4rl": "it imports mujoco_py, which compiles itself into the environment",
    "isaacgym": "it compiles itself when it is imported",
    "isaaclab": "it starts a simulator when it is imported",
    "isaacsim": "it starts a simulator when it is imported",
}
"""What is not imported, and why."""

SIMULATORS = frozenset(
    "gym gymnasium mujoco mujoco-py dm-control robosuite pybullet gymnasium-robotics metaworld pettingzoo torchrl brax"
    " mujoco-mjx mujoco-warp newton robomimic diffusion-policy isaacgym isaaclab".split()
)
"""What somebody has an environment for."""

WEIGHTS: Dict[str, int] = dict.fromkeys(SIMULATORS, 5)
WEIGHTS.update(dict.fromkeys(("torch", "jax", "jaxlib", "tensordict", "stable-baselines3", "warp-lang"), 4))
WEIGHTS.update(
    dict.fromkeys(
        (
            "numpy scipy pygame pygame-ce pyglet glfw pyopengl opencv-python opencv-python-headless shimmy imageio"
            " box2d-py box2d ale-py numba h5py"
        ).split(),
        2,
    )
)


def weight(name: str) -> int:
    """How much it counts that a package has to change; 0 for one that seldom is the cause."""
    return WEIGHTS.get(name, 0)

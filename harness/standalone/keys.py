"""List the packages that decide whether a simulation runs: their modules, and the weight of a change of each.

Those of a simulator are declared by its adapter.
"""

from __future__ import annotations

from typing import Dict

from .adapters import adapters

BESIDE = {
    "numpy": "numpy",
    "scipy": "scipy",
    "gymnasium-robotics": "gymnasium_robotics",
    "metaworld": "metaworld",
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
    "warp-lang": "warp",
    "numba": "numba",
    "h5py": "h5py",
    "robomimic": "robomimic",
}
"""Modules of distributions that no adapter declares."""

ORDER = (
    "numpy scipy gym gymnasium mujoco dm-control robosuite pybullet gymnasium-robotics metaworld pettingzoo shimmy"
    " stable-baselines3 pygame pygame-ce pyglet glfw pyopengl opencv-python opencv-python-headless"
    " opencv-contrib-python opencv-contrib-python-headless imageio box2d-py box2d ale-py torch torchrl tensordict jax"
    " mujoco-mjx brax warp-lang mujoco-warp newton numba h5py robomimic diffusion-policy"
).split()
"""The order in which modules are tried, as one may disturb another; those that are not named follow."""

DECLARED: Dict[str, str] = {
    name: module for adapter in adapters().values() for name, module in adapter.packages.items()
}
LEFT_OUT = {
    "mujoco-py": "it compiles itself into the environment when it is imported",
    "d4rl": "it imports mujoco_py, which compiles itself into the environment",
}
"""What is not imported, and why."""

LEFT_OUT.update({name: why for adapter in adapters().values() for name, why in adapter.not_imported.items()})
IMPORTED = {name: module for name, module in {**BESIDE, **DECLARED}.items() if name not in LEFT_OUT}
MODULES = {name: IMPORTED[name] for name in [*ORDER, *IMPORTED] if name in IMPORTED}
"""Distribution: the module that it is imported as, in the order in which they are tried."""

SIMULATORS = frozenset(["gymnasium-robotics", "metaworld", "mujoco-py", "robomimic", "torchrl", *DECLARED])
"""What somebody has an environment for."""

# Simulators weigh most: the nearest combination changes numpy rather than what somebody has an environment for.
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
    """Return how much it counts that a package has to change; 0 for one that seldom is the cause."""
    return WEIGHTS.get(name, 0)

"""Tell which package has a module, where its name is another one or people meet it by its import alone."""

from __future__ import annotations

from typing import Optional

from .api_history import OF_IMPORT

OTHERS = {
    "Box2D": "box2d", "OpenGL": "pyopengl", "PIL": "pillow", "ale_py": "ale-py", "atari_py": "atari-py",
    "brax": "brax", "cv2": "opencv-python", "d4rl": "d4rl", "diffusers": "diffusers", "envpool": "envpool",
    "glfw": "glfw", "h5py": "h5py", "imageio": "imageio", "imageio_ffmpeg": "imageio-ffmpeg", "jax": "jax",
    "jaxlib": "jaxlib", "labmaze": "labmaze", "matplotlib": "matplotlib", "minari": "minari", "minigrid": "minigrid",
    "moviepy": "moviepy", "mujoco.mjx": "mujoco-mjx", "panda_gym": "panda-gym", "pygame": "pygame", "pyglet": "pyglet",
    "ray": "ray", "robomimic": "robomimic", "scipy": "scipy", "shimmy": "shimmy", "skimage": "scikit-image",
    "sklearn": "scikit-learn", "supersuit": "supersuit", "tensorboard": "tensorboard", "tensordict": "tensordict",
    "tianshou": "tianshou", "torch": "torch", "torchrl": "torchrl", "torchvision": "torchvision", "tqdm": "tqdm",
    "wandb": "wandb", "yaml": "pyyaml",
}  # fmt: skip


def package_with(module: str) -> Optional[str]:
    """Return the package that has a module; None if none is known."""
    top = module.partition(".")[0]
    return OTHERS.get(module) or OTHERS.get(top) or OF_IMPORT.get(top)

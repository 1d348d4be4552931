"""Wrap a PettingZoo environment with SuperSuit, as its tutorials do, and make a vector environment of it."""

import importlib

from .cell_errors import library, skip, violate
from .cell_interop import import_trainer, make_environment

SIDE, STACK = 84, 3
"""The side of a picture after the wrappers, and how many follow each other in an observation."""

PICTURE = 3
"""The dimensions of an observation that is a picture: height, width, channel."""

COPIES = 2
"""Copies of an environment that make one vector environment; each has several agents."""


def make_vector(probe, facts, base_class):
    """Return a vector environment of this library's class, in which each agent is an environment."""
    supersuit = import_trainer("supersuit", "supersuit")
    facts["version"] = {"library": str(supersuit.__version__)}
    with library:
        raw = make_environment(probe)
    if hasattr(raw, "agent_iter"):
        skip("supersuit.turns")
    with library:
        env = _wrap_pictures(supersuit, raw)
        vector = supersuit.pettingzoo_env_to_vec_env_v1(env)
        return env, supersuit.concat_vec_envs_v1(vector, COPIES, num_cpus=1, base_class=base_class)


def make_wrapped(probe):
    """Return one PettingZoo environment with the same wrappers."""
    with library:
        return _wrap_pictures(importlib.import_module("supersuit"), make_environment(probe))


def _wrap_pictures(supersuit, env):
    """Make pictures grey and small, and stack them; leave other observations as they are."""
    if len(env.observation_space(env.possible_agents[0]).shape) != PICTURE:
        return env
    env = supersuit.color_reduction_v0(env, mode="B")
    env = supersuit.resize_v1(env, x_size=SIDE, y_size=SIDE)
    return supersuit.frame_stack_v1(env, STACK)


def check_batch(name, value, promised):
    """Raise a violation where values of a vector environment are not of the promised shape."""
    import numpy as np

    shape = np.asarray(value).shape
    if shape != promised:
        violate("supersuit.shape", part=name, got=str(shape), promised=str(promised))

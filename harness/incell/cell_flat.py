"""Flatten observations into one array of numbers, and tell their precision."""

import numpy as np


def flat(observation):
    """Return an observation as one array of numbers; parts of a dict in the order of their names."""
    if hasattr(observation, "items"):
        parts = [flat(observation[name]) for name in sorted(observation, key=str)]
        return np.concatenate(parts) if parts else np.zeros(0)
    if isinstance(observation, (tuple, list)):
        return np.concatenate([flat(part) for part in observation]) if observation else np.zeros(0)
    return np.asarray(observation, dtype=float).ravel()


def precision_of(observation):
    """Return the coarsest float type of an observation's parts, as its name."""
    if hasattr(observation, "items"):
        observation = list(observation.values())
    if isinstance(observation, (tuple, list)) and observation:
        return min((precision_of(part) for part in observation), key=lambda name: np.dtype(name).itemsize)
    kind = np.asarray(observation).dtype
    return kind.name if kind.kind == "f" else "float64"

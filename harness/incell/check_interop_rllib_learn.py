"""Let RLlib learn: PPO in this process, without workers of its own."""

import importlib
import math

from .cell_errors import library, violate
from .cell_interop import import_trainer, make_environment
from .cell_learners import compare_parameters, seed_torch

STEPS = 64
MEMORY = 80 * 1024 * 1024
"""Bytes of Ray's object store: about the least that it accepts."""


def run(probe, facts):
    """Let PPO learn for one iteration of few steps on the CPU, and evaluate for one episode."""
    ray = import_trainer("ray", "ray")
    ppo = import_trainer("ray.rllib.algorithms.ppo", "ray[rllib]")
    registry = importlib.import_module("ray.tune.registry")
    seed_torch(probe, facts, ray)
    with library:
        ray.init(num_cpus=1, num_gpus=0, include_dashboard=False, object_store_memory=MEMORY, log_to_driver=False)
    algorithm = None
    try:
        with library:
            registry.register_env("simmatrix", lambda _: make_environment(probe))
            algorithm = _configure(ppo, probe.case["seed"]).build()
        before = _weights(algorithm)
        with library:
            result = algorithm.train()
            evaluation = algorithm.evaluate()
        compare_parameters(before, _weights(algorithm))
        facts["steps"] = int(_find(result, "num_env_steps_sampled_lifetime", "timesteps_total"))
        got = _find(evaluation, "episode_return_mean", "episode_reward_mean")
        if got is None or not math.isfinite(got):
            violate("interop.return", got=str(got))
    finally:
        with library:
            if algorithm is not None:
                algorithm.stop()
            ray.shutdown()


def _configure(ppo, seed):
    """Return the settings of a short training, by the names that this release has for them."""
    config = ppo.PPOConfig().environment("simmatrix").framework("torch").debugging(seed=seed)
    if hasattr(config, "env_runners"):
        config = config.env_runners(num_env_runners=0)
    else:
        config = config.rollouts(num_rollout_workers=0)
    size = "minibatch_size" if hasattr(config, "minibatch_size") else "sgd_minibatch_size"
    epochs = "num_epochs" if hasattr(config, "num_epochs") else "num_sgd_iter"
    config = config.training(train_batch_size=STEPS, **{size: STEPS // 2, epochs: 1})
    return config.evaluation(evaluation_interval=None, evaluation_duration=1)


def _weights(algorithm):
    """Copy the weights of the policy into one array."""
    import numpy as np

    weights = algorithm.get_weights()["default_policy"]
    return np.concatenate([np.asarray(part, dtype=float).ravel().copy() for part in weights.values()])


def _find(result, *names):
    """Return the first value with one of these names, at any depth."""
    for name in names:
        for part in _tables(result):
            if part.get(name) is not None:
                return part[name]
    return None


def _tables(value):
    """Yield a dict and all dicts in it."""
    yield value
    for part in value.values():
        if isinstance(part, dict):
            yield from _tables(part)

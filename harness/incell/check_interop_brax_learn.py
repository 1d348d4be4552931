"""Let Brax learn: its PPO on an environment of its own, compiled as a whole."""

import importlib
import math

from .cell_callables import local_name
from .cell_errors import library
from .cell_interop import import_trainer
from .cell_learners import check_return, compare_parameters

STEPS, LENGTH, ENVS, UNROLL = 128, 20, 4, 4


def run(probe, facts):
    """Learn for a few steps on the CPU, and evaluate by the trainer before and after."""
    brax = import_trainer("brax", "brax")
    ppo = import_trainer("brax.training.agents.ppo.train", "brax")
    jax = importlib.import_module("jax")
    case, weights, returns = probe.case, [], []

    def keep_weights(step, make_policy, parameters):
        weights.append(_copy(jax, parameters[1]))  # after what normalizes, which counts steps

    def keep_return(step, metrics):
        returns.append(float(metrics.get("eval/episode_reward", math.nan)))

    with library:
        env = importlib.import_module("brax.envs").get_environment(local_name(case), **case["kwargs"])
        ppo.train(
            environment=env, num_timesteps=STEPS, episode_length=LENGTH, num_envs=ENVS, batch_size=ENVS,
            num_minibatches=1, unroll_length=UNROLL, num_updates_per_batch=1, num_evals=3, num_eval_envs=ENVS,
            normalize_observations=True, seed=case["seed"], progress_fn=keep_return, policy_params_fn=keep_weights,
        )  # fmt: skip
    compare_parameters(weights[0], weights[-1])
    for total in returns or [math.nan]:
        check_return(total)
    facts["version"] = {"library": str(getattr(brax, "__version__", "?")), "jax": str(jax.__version__)}
    facts["steps"], facts["evaluated"] = STEPS, len(returns)


def _copy(jax, parameters):
    """Copy all numbers of a tree into one array."""
    import numpy as np

    leaves = jax.tree_util.tree_leaves(parameters)
    return np.concatenate([np.asarray(leaf, dtype=float).ravel().copy() for leaf in leaves])

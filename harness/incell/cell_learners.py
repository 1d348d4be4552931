"""Help the checks of libraries that train: whether training changed the policy, and an episode that it plays."""

import importlib
import math

from .cell_errors import library, violate
from .cell_interop import close

LONGEST = 200
"""Steps of an evaluation; an episode that goes on is left there."""


def seed_torch(probe, facts, module):
    """Seed torch, and note the releases that train."""
    torch = importlib.import_module("torch")
    torch.manual_seed(probe.case["seed"])
    facts["version"] = {"library": str(getattr(module, "__version__", "?")), "torch": str(torch.__version__)}
    return torch


def copy_parameters(network):
    """Copy all parameters of a network into one array."""
    import numpy as np

    return np.concatenate([part.detach().cpu().numpy().ravel().copy() for part in network.parameters()])


def compare_parameters(before, after):
    """Refuse parameters that training did not change, or that are no numbers."""
    import numpy as np

    if not np.isfinite(after).all():
        violate("interop.not_finite", number=int((~np.isfinite(after)).sum()), size=int(after.size))
    if before.shape == after.shape and (before == after).all():
        violate("interop.unchanged", size=int(after.size))


def learn(facts, model, steps):
    """Let a model of Stable-Baselines3 learn; its steps have to be those asked for, and its policy another one."""
    before = copy_parameters(model.policy)
    with library:
        model.learn(total_timesteps=steps)
    compare_parameters(before, copy_parameters(model.policy))
    check_count(steps, model.num_timesteps)
    facts["steps"] = steps


def check_count(promised, got):
    """Refuse another number of steps than was asked for."""
    if int(got) != promised:
        violate("interop.steps", promised=promised, got=int(got))


def play_episode(facts, env, act):
    """Play an episode of Gymnasium with a policy, and note its length; the sum of its rewards has to be a number."""
    total, steps, ended = 0.0, 0, False
    try:
        with library:
            observation, _ = env.reset(seed=1)
            while not ended and steps < LONGEST:
                observation, reward, terminated, truncated, _ = env.step(act(observation))
                total, steps, ended = total + float(reward), steps + 1, bool(terminated or truncated)
    finally:
        close(env)
    check_return(total)
    facts["evaluated"] = steps


def check_return(total):
    """Refuse a sum of rewards that is no number."""
    if not math.isfinite(total):
        violate("interop.return", got=str(total))

"""Compare the vector environment of MO-Gymnasium with single environments: rewards are several numbers."""

import importlib

from .cell_episode import count_steps
from .cell_errors import library, violate
from .cell_interop import close, import_trainer, make_environment


def run(probe, facts):
    """Step some environments as one and each alone, until an episode ends; the rewards have to be the same."""
    make = _vector_class(import_trainer("mo_gymnasium", "mo-gymnasium"))
    with library:
        vector = make([lambda: make_environment(probe)] * probe.num_envs)
        singles = [make_environment(probe) for _ in range(probe.num_envs)]
    try:
        facts["environments"], facts["steps"] = probe.num_envs, _compare(probe, vector, singles)
    finally:
        for env in [vector, *singles]:
            close(env)


def _vector_class(mo_gymnasium):
    """Return the class, which 1.2 moved below `wrappers`."""
    if hasattr(mo_gymnasium, "MOSyncVectorEnv"):
        return mo_gymnasium.MOSyncVectorEnv
    with library:
        return importlib.import_module("mo_gymnasium.wrappers.vector").MOSyncVectorEnv


def _compare(probe, vector, singles):
    """Return how many steps were compared."""
    seed = probe.case["seed"]
    with library:
        vector.action_space.seed(seed)
        vector.reset(seed=seed)
        for number, env in enumerate(singles):
            env.reset(seed=seed + number)
    for step in count_steps(probe.case["steps"]):
        with library:
            actions = vector.action_space.sample()
            together = vector.step(actions)
            alone = [env.step(action) for env, action in zip(singles, actions)]
        _compare_rewards(together[1], [values[1] for values in alone])
        if any(values[2] or values[3] for values in alone):
            return step + 1
    return probe.case["steps"]


def _compare_rewards(together, alone):
    """Raise a violation where the rewards of the vector environment are not those of the single ones."""
    import numpy as np

    together, alone = np.asarray(together), np.asarray(alone)
    if together.shape != alone.shape:
        violate("mo_gymnasium.shape", got=str(together.shape), promised=str(alone.shape))
    if not np.allclose(together, alone, atol=1e-5):
        violate("mo_gymnasium.rewards", got=str(together.tolist()), promised=str(alone.tolist()))
